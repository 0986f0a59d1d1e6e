"""What follows from the message types: JSON Schema, tables, byte vectors."""
