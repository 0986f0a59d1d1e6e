"""The bridge: takes part in a run in the stead of a program without Zenoh (docs/bridge.md)."""

from .formats import FORMATS, RAW_TYPES, Format, bridge_words, raw_mistake

__all__ = ["FORMATS", "RAW_TYPES", "Format", "bridge_words", "raw_mistake"]
