"""What a run decides, as pure logic: no bus, no clock, no process.

phase: which phase of a run may follow which. participants: who takes part, and how far each is.
barrier: which steps are complete, and who holds the oldest. gates: how far the run may go.
deadlines: who is late. failures: the sentence that says so. messages: what participants report.
admission: who may join. descriptions: whether outputs are described consistently.
"""
