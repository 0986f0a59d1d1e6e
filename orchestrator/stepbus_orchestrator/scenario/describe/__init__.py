"""Tables and JSON Schemas out of declared parameters."""
