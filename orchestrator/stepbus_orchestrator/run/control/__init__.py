"""What acts on a run from outside its participants: pace, calls, injected faults."""
