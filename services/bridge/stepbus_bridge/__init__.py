"""The bridge: takes part in a run on behalf of a program without Zenoh (docs/guide/bridge.md)."""
