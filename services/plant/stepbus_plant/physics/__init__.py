"""The physics engine, and the joints it simulates."""
