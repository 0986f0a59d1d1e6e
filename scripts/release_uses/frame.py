"""A recording as a table of pandas."""

import stepbus

frame = stepbus.Recording("run.mcap").frame("plant/joint_state")
assert type(frame).__module__.startswith("pandas")
assert len(frame) > 0
