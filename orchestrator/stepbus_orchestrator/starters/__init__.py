"""What `stepbus new` writes."""
