"""What MJCF has and URDF has not is refused or named."""

import warnings

import pytest
from support.mjcf import FINGER, converted, part

from stepbus_participant import mjcf_model, urdf_warnings
from stepbus_participant.mjcf_kinds import KINDS
from stepbus_schemas import WiringError

pytest.importorskip("mujoco", reason="the package mujoco is not installed")

# Each kind of thing that a URDF has no words for, and a model that has it.
SPRING = '<tendon><fixed name="t" {}><joint joint="hinge" coef="1"/></fixed></tendon>'
FLEX = '<flexcomp name="f" type="grid" count="2 2 2" spacing=".1 .1 .1" dim="3" mass="1"/>'
FLAT = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>'
SAMPLES = {
    "ball joints": part(body='<body><joint name="b" type="ball"/><geom size=".1"/></body>'),
    "joint springs": part(joint='stiffness="5"'),
    "tendons with a spring": part(SPRING.format('limited="true" range="-1 1"')),
    "constraints `connect`": part('<equality><weld body1="arm"/></equality>'),
    "joint couplings": part(
        '<equality><joint joint1="hinge" joint2="slide" polycoef="0 1 2 0 0"/></equality>',
        body=FINGER,
    ),
    "joints that follow two": part(
        '<equality><joint joint1="slide" joint2="hinge"/><joint joint1="slide" joint2="hinge"/>'
        "</equality>",
        body=FINGER,
    ),
    "muscles": part('<actuator><muscle joint="hinge" lengthrange="0 1"/></actuator>'),
    "flexes": part(before='<option solver="CG"/>').replace(
        "</body></body>", f"</body>{FLEX}</body>"
    ),
    "plugins": part(
        before='<extension><plugin plugin="mujoco.pid"/></extension>',
        extra='<actuator><plugin joint="hinge" plugin="mujoco.pid"><config key="kp" value="1"/>'
        "</plugin></actuator>",
    ),
    "collision geoms": part(solid='type="ellipsoid"').replace('size=".1"', 'size=".1 .2 .3"'),
    "meshes not in": part(
        before='<asset><mesh name="m" builtin="sphere" params="2"/></asset>',
        body='<geom name="ball" type="mesh" mesh="m"/>',
    ),
    "visual-only geoms": part(
        body='<geom type="ellipsoid" size=".1 .2 .3" contype="0" conaffinity="0"/>'
    ),
    "`armature`": part(joint='armature=".1"'),
    "`gravcomp`": part().replace('name="arm"', 'name="arm" gravcomp="1"', 1),
    "actuators of anything": part(
        SPRING.format("") + '<actuator><motor name="pull" tendon="t"/></actuator>'
    ),
    "geoms of the `<worldbody>`": part(before=FLAT).replace(
        "<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/>'
    ),
    "different friction": part(body='<geom size=".1" friction=".3"/>'),
    "contact pairs": part('<contact><pair geom1="arm" geom2="finger"/></contact>', body=FINGER),
    "adhesion and surface": part(solid='surfacevel="1 0 0 0 0 0"'),
    "density, viscosity": part(before='<option density="1000"/>'),
}


@pytest.mark.parametrize("start", SAMPLES)
def test_what_urdf_has_no_words_for_is_refused_or_named(tmp_path, start):
    (kind,) = [kind for kind in KINDS if kind.find and kind.what.startswith(start)]
    if kind.fate == "refused":
        with pytest.raises(WiringError) as refused:
            converted(tmp_path, SAMPLES[start])
        (line,) = str(refused.value).splitlines()
        assert line.startswith(f"{tmp_path}/arm.xml: {kind.what} (")
        assert line.endswith(f"): not supported; {kind.instead}")
    else:
        (warning,) = urdf_warnings(converted(tmp_path, SAMPLES[start]))
        lead = "URDF cannot express some of this MJCF, which is ignored: "
        assert warning.startswith(f"{lead}{kind.what} (")
        assert ";" not in warning


def test_what_changes_nothing_is_left_out_silently(tmp_path):
    extra = '<equality><weld body1="arm" active="false"/></equality>' + SPRING.format("")
    extra += '<keyframe><key qpos="1"/></keyframe><sensor><jointpos joint="hinge"/></sensor>'
    seen = '<site/><camera/><light/><geom type="sphere" size="9" contype="0" conaffinity="0" group="4"/>'
    robot = converted(tmp_path, part(extra, body=seen))
    assert urdf_warnings(robot) == []
    assert len(robot.findall("link[@name='arm']/visual")) == 1


def test_warnings_of_the_compiler_are_passed_on(tmp_path, monkeypatch):
    compiled = mjcf_model.compiled

    def complain(spec):
        warnings.warn("geom 'arm' is\nodd", UserWarning, stacklevel=2)
        return compiled(spec)

    monkeypatch.setattr(mjcf_model, "compiled", complain)
    assert urdf_warnings(converted(tmp_path, part())) == ["MuJoCo warns: geom 'arm' is odd"]
