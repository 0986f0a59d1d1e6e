"""What all phases of a run share, and what a replay or a description does differently."""
