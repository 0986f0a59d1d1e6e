"""Scripts for CoppeliaSim's remote API, new and old, take part in runs as they are."""
