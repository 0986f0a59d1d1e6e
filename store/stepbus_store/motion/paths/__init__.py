"""Paths without time: of the joints, and of the tip, straight and spiral."""
