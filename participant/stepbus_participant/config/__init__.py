"""The configuration of one participant: parameters, ports, and classes that a scenario chooses."""

from .config import Config
from .ports import Ports

__all__ = ["Config", "Ports"]
