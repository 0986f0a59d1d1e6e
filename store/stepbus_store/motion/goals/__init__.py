"""Goals: from their start to their outcome."""
