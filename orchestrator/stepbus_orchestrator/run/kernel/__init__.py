"""What a run decides, as pure logic: no bus, no clock, no process.

state: its phase, how far it is, who takes part. participants: how far each is. barrier: which steps
are complete, who holds the oldest, and how far the run may go. deadlines: who is late. failures:
the error that says so. messages: what participants report. admission: who may join. descriptions:
whether outputs are described consistently.
"""
