"""The stock of a store: items of several types on shelves, as bodies of the plant's world."""

from .slots import Stock

__all__ = ["Stock"]
