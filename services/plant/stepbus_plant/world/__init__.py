"""What a world consists of: its file, models, shapes, stock, and what happens to it in a run."""
