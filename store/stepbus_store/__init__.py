"""A mobile manipulator that sells goods, and Baxter: services and scenarios on top of stepbus."""
