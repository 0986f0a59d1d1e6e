"""What a run decides, as pure logic: no bus, no clock, no process."""
