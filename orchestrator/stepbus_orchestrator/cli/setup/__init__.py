"""Commands that set something up."""
