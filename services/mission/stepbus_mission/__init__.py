"""The mission: references with exact derivatives, from a generator of your choice."""

from .mission import Mission as Mission
from .params import Params as Params
