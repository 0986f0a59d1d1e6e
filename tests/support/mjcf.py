"""Small models in MJCF."""

from stepbus_models import read_robot

SLIDE = '<body name="hand"><joint name="slide" type="slide" axis="1 0 0" range="0 1"/>{}</body>'
FINGER = SLIDE.format('<geom name="finger" size=".1" mass="1"/>')


def save(folder, text, name="arm.xml"):
    """Write a file; return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def part(extra="", body="", joint="", solid="", before=""):
    """Return an MJCF of a base and an arm on a hinge; with what is added to it."""
    return f"""<mujoco>{before}<worldbody><body name="base"><geom size=".1"/>
<body name="arm"><joint name="hinge" axis="0 1 0" {joint}/><geom name="arm" size=".1" pos="1 0 0"
{solid}/>{body}</body></body></worldbody>{extra}</mujoco>"""


def robot_of(folder, text):
    """Return the robot of an MJCF."""
    return read_robot(save(folder, text))
