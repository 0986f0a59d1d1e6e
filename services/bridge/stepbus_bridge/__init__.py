"""The bridge: takes part in a run for a program without Zenoh (docs/guide/writing/bridge.md)."""
