"""Example values of every message type, as the maps they are on the wire.

Fields stand in the order of their type and defaults are left out, as our encoder does it. Every
type has a `minimal` value: the required fields only.
"""

from __future__ import annotations

from typing import Any

Value = dict[str, Any]

_FLOATS = [float("nan"), float("inf"), float("-inf"), -0.0, 5e-324, 1.7976931348623157e308]
_UNICODE = "bras gauche · 左腕 · 🦾 · \N{COMBINING ACUTE ACCENT}e · \0\n\"'\\"
_RUN = {"token": "6f1d0c52"}
_STEP_1: Value = {**_RUN, "step": 1, "t_ns": 5000000}
_DESCRIPTION: Value = {
    "names": ["shoulder", "elbow"],
    "units": {"values": "N·m"},
    "limits": {"lower": [-3.14, -2.5], "upper": [3.14, 2.5], "effort": [50.0, 50.0]},
    "details": {"mode": ["torque", "torque"]},
}

_PORTS: dict[str, dict[str, Value]] = {
    "BaseCommand/1": {
        "minimal": {},
        "full": {"vx": 0.5, "wz": -0.25, "wheels": [5.0, -5.0]},
        "extreme floats": {"vx": _FLOATS[0], "wz": _FLOATS[2], "wheels": [-0.0, _FLOATS[1]]},
    },
    "BaseState/1": {
        "minimal": {"x": 0.0, "y": 0.0, "yaw": 0.0, "vx": 0.0, "wz": 0.0},
        "full": {"x": 1.5, "y": -0.25, "yaw": 7.5, "vx": 0.5, "wz": -0.5},
        "extreme floats": dict(zip(("x", "y", "yaw", "vx", "wz"), _FLOATS[:5], strict=True)),
    },
    "Contacts/1": {
        "minimal": {"pairs": [], "force": [], "distance": [], "position": []},
        "full": {
            "pairs": [["can", "table"], ["pad_left", _UNICODE]],
            "force": [3.5, 15.0],
            "distance": [-0.0005, 0.0],
            "position": [[0.5, -0.25, 1.0], [0.0, 0.125, 2.0]],
        },
        "extreme floats": {
            "pairs": [["a", "b"]],
            "force": _FLOATS[:1],
            "distance": _FLOATS[1:2],
            "position": [_FLOATS[2:5]],
        },
    },
    "ControllerStatus/1": {
        "minimal": {"error": [], "saturated": []},
        "full": {
            "error": [0.25, -0.125],
            "saturated": [True, False],
            "warnings": ["elbow is at its limit"],
        },
        "unicode": {"error": [0.0], "saturated": [False], "warnings": [_UNICODE, ""]},
        "extreme floats": {"error": _FLOATS, "saturated": [False] * len(_FLOATS)},
    },
    "Detections/1": {
        "minimal": {
            "frame": "",
            "types": [],
            "position": [],
            "orientation": [],
            "confidence": [],
        },
        "full": {
            "frame": "chassis",
            "types": ["cola", _UNICODE],
            "position": [[0.5, -0.25, 1.0], [0.0, 0.125, 2.0]],
            "orientation": [[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5]],
            "confidence": [0.75, 1.0],
        },
        "extreme floats": {
            "frame": "a",
            "types": ["b"],
            "position": [_FLOATS[:3]],
            "orientation": [_FLOATS[2:6]],
            "confidence": _FLOATS[:1],
        },
    },
    "Event/1": {
        "minimal": {"level": "info", "text": ""},
        "full": {"level": "warning", "text": "the elbow is slow"},
        "unicode": {"level": "error", "text": _UNICODE},
        "long text": {"level": "info", "text": "ä" * 150},
    },
    "Goal/1": {
        "minimal": {"id": 0, "type": "stop"},
        "joints": {"id": 1, "type": "move_joints", "joints": ["elbow"], "values": [0.5]},
        "extreme floats": {
            "id": 4,
            "type": "move_joints",
            "joints": ["elbow"] * len(_FLOATS),
            "values": _FLOATS,
        },
        "pose": {
            "id": 2**63,
            "type": "move_to_pose",
            "tip": "left_gripper",
            "position": [0.5, -0.25, -0.0],
            "orientation": [0.0, 0.0, 0.0, 1.0],
        },
        "full": {
            "id": 3,
            "type": "move_to_pose",
            "joints": ["shoulder", "elbow"],
            "values": [0.5, -1.5],
            "tip": _UNICODE,
            "position": [1.0, 2.0, 3.0],
            "orientation": [0.5, 0.5, 0.5, 0.5],
            "frame": "torso",
            "duration": 2.5,
            "touches": ["can", _UNICODE],
            "by": -0.5,
            "base": [1.5, -0.25, 0.5],
            "width": 0.066,
            "force": 15.0,
            "spiral": {
                "centre": [0.5, 0.25, -0.0],
                "radius": [0.25, 0.125],
                "turns": 3.5,
                "rise": 0.5,
            },
        },
        "go to": {"id": 5, "type": "go_to", "base": _FLOATS[:3]},
    },
    "GoalStatus/1": {
        "minimal": {"id": 0, "state": "accepted"},
        "full": {"id": 7, "state": "failed", "cause": "unreachable", "text": "it is 80.5 mm away"},
        "unicode": {"id": 8, "state": "succeeded", "text": _UNICODE},
    },
    "GripperCommand/1": {
        "minimal": {"width": 0.0, "force": 0.0},
        "full": {"width": 0.066, "force": 15.0},
        "odd": {"width": _FLOATS[0], "force": _FLOATS[1]},
        "extreme floats": {"width": _FLOATS[3], "force": _FLOATS[2]},
    },
    "GripperState/1": {
        "minimal": {"width": 0.0, "force": 0.0, "holding": False},
        "full": {"width": 0.066, "force": 15.0, "holding": True},
        "odd": {"width": _FLOATS[0], "force": _FLOATS[1], "holding": True},
        "extreme floats": {"width": _FLOATS[3], "force": _FLOATS[2], "holding": False},
    },
    "Image/1": {
        "minimal": {
            "width": 0,
            "height": 0,
            "encoding": "rgb8",
            "data": b"",
            "focal": [1.0, 1.0],
            "centre": [0.0, 0.0],
        },
        "full": {
            "width": 2,
            "height": 1,
            "encoding": "32FC1",
            "data": b"\x00\x00\x80\x3f\x00\x00\x00\x40",
            "focal": [200.5, 200.25],
            "centre": [0.5, 0.0],
        },
        "no text": {
            "width": 1,
            "height": 1,
            "encoding": "rgb8",
            "data": b"\xff\xc1\x00",
            "focal": _FLOATS[:2],
            "centre": _FLOATS[2:4],
        },
    },
    "JointCommand/1": {
        "minimal": {"mode": "torque", "values": []},
        "full": {
            "mode": "position",
            "values": [0.5, -1.5],
            "velocity": [0.1, 0.2],
            "effort_limit": [50.0, 15.0],
        },
        "empty vectors": {"mode": "velocity", "values": [], "velocity": [], "effort_limit": []},
        "extreme floats": {"mode": "teleport", "values": _FLOATS},
    },
    "JointReference/1": {
        "minimal": {"position": [], "velocity": [], "acceleration": []},
        "full": {"position": [0.0, 1.0], "velocity": [1.0, 0.0], "acceleration": [-0.0, -1.0]},
        "sixteen joints": {
            "position": [0.1 * joint for joint in range(16)],
            "velocity": [0.0] * 16,
            "acceleration": [1e-9] * 16,
        },
        "extreme floats": {"position": _FLOATS, "velocity": _FLOATS, "acceleration": _FLOATS},
    },
    "JointState/1": {
        "minimal": {},
        "positions only": {"position": [0.1, 0.2]},
        "full": {
            "position": [0.1, 0.2],
            "velocity": [-0.5, 0.5],
            "effort": [12.5, -50.0],
            "target": [0.0, 3.141592653589793],
        },
        "empty vectors": {"position": [], "velocity": [], "effort": [], "target": []},
        "extreme floats": {"position": _FLOATS, "effort": _FLOATS},
    },
    "Plan/1": {
        "minimal": {"id": 0},
        "full": {
            "id": 3,
            "cause": "no_path",
            "text": _UNICODE,
            "times": [0.0, 0.5],
            "position": [[0.0, 1.0], [0.5, -1.0]],
            "velocity": [[0.0, 0.0], [0.25, -0.25]],
        },
        "extreme floats": {
            "id": 2**63,
            "times": _FLOATS,
            "position": [_FLOATS, []],
            "velocity": [_FLOATS],
        },
    },
    "PlanRequest/1": {
        "minimal": {"id": 0, "start": [], "goal": []},
        "full": {
            "id": 3,
            "start": [0.0, 1.0],
            "goal": [0.5, -1.0],
            "held": "cola_a1_3",
            "touches": ["a_tier1", _UNICODE],
        },
        "extreme floats": {"id": 4, "start": _FLOATS, "goal": _FLOATS},
    },
    "Poses/1": {
        "minimal": {"position": [], "orientation": []},
        "full": {
            "position": [[0.5, -0.25, 1.0], [0.0, -0.0, 5e-324]],
            "orientation": [[0.0, 0.0, 0.0, 1.0], [0.5, -0.5, 0.5, -0.5]],
        },
        "extreme floats": {"position": [_FLOATS[:3], _FLOATS[3:]], "orientation": [_FLOATS[2:]]},
    },
}

_JOINING: dict[str, dict[str, Value]] = {
    "Hello/1": {
        "minimal": {"protocol": 1, "name": "plant", **_RUN, "pid": 4711},
        "full": {
            "protocol": 1,
            "name": "controller",
            **_RUN,
            "pid": 4194304,
            "language": "python",
            "sdk": "stepbus 0.1.0",
            "inputs": {"joint_state": "JointState/1"},
            "outputs": {"command": "JointCommand/1"},
        },
        "no ports": {
            "protocol": 1,
            "name": "idle",
            **_RUN,
            "pid": 1,
            "inputs": {},
            "outputs": {},
        },
        "unicode": {"protocol": 1, "name": _UNICODE, "token": "", "pid": 0},
    },
    "Welcome/1": {
        "minimal": {
            "protocol": 1,
            "name": "plant",
            **_RUN,
            "step_ns": 5000000,
            "every": 1,
            "publishes": "first",
            "window": 1,
            "batch": 1,
            "seed": 0,
            "inputs": {},
            "outputs": {},
            "params": {},
            "folder": "/",
        },
        "full": {
            "protocol": 1,
            "name": "controller",
            **_RUN,
            "step_ns": 2**63 - 1,
            "every": 4,
            "publishes": "last",
            "window": 64,
            "batch": 32,
            "seed": 2**64 - 1,
            "inputs": {
                "joint_state": {"source": "plant", "port": "joint_state", "type": "JointState/1"},
                "camera": {
                    "source": "plant",
                    "port": "rgb",
                    "type": "Image/1",
                    "delay": 1,
                    "every": 20,
                    "bulk": True,
                },
            },
            "outputs": {
                "command": {"type": "JointCommand/1"},
                "picture": {"type": "Image/1", "bulk": True},
            },
            "params": {
                "law": "computed_torque",
                "kp": 100,
                "kd": [20.0, 2**53 + 1],
                "filter": None,
                "nested": {"on": True, "off": False, "": {}},
            },
            "folder": "/home/ä b/szenario",
            "max_outputs_bytes": 1000000,
        },
    },
    "Refusal/1": {
        "minimal": {"reason": ""},
        "full": {"reason": "controller: input joint_state is JointState/1, not JointState/2"},
        "unicode": {"reason": _UNICODE},
    },
    "Ready/1": {
        "minimal": {"name": "plant", **_RUN},
        "full": {
            "name": "plant",
            **_RUN,
            "outputs": {
                "joint_state": _DESCRIPTION,
                "rgb": {"names": ["head"], "shape": [480, 640, 3]},
                "echo": {"like": "joint_state"},
                "nothing": {},
            },
            "versions": {"pybullet": "3.2.7"},
            "calls": {"put": {"help": "NAME RAD: puts a joint somewhere", "changes": True}},
        },
        "extreme floats": {
            "name": "plant",
            **_RUN,
            "outputs": {"wheels": {"limits": {"upper": _FLOATS}}},
        },
    },
    "Start/1": {
        "minimal": {**_RUN, "inputs": {}},
        "full": {
            **_RUN,
            "inputs": {"controller": {"joint_state": _DESCRIPTION}, "plant": {"command": {}}},
        },
        "unicode": {**_RUN, "inputs": {_UNICODE: {"ä": {"names": [_UNICODE]}}}},
        "extreme floats": {
            **_RUN,
            "inputs": {"plant": {"wheels": {"limits": {"upper": _FLOATS}}}},
        },
    },
}

_STEPPING: dict[str, dict[str, Value]] = {
    "Trigger/1": {
        "minimal": {**_RUN, "step_limit": 0},
        "full": {**_RUN, "step_limit": 2000},
        "latest step": {**_RUN, "step_limit": 2**64 - 1},
    },
    "Outputs/1": {
        "minimal": {**_RUN, "step": 0, "t_ns": 0},
        "handshake": {**_RUN, "step": -1, "t_ns": 0},
        "full": {
            **_RUN,
            "step": 1042,
            "t_ns": 5210000000,
            "ports": {
                "joint_state": _PORTS["JointState/1"]["full"],
                "event": _PORTS["Event/1"]["unicode"],
            },
            "bulk": {"rgb": 921600},
            "end": "all orders are served",
        },
        "extreme floats": {
            **_STEP_1,
            "ports": {"reference": _PORTS["JointReference/1"]["extreme floats"]},
        },
        "latest step": {**_RUN, "step": 2**63 - 1, "t_ns": 2**63 - 1},
    },
    "Chain/1": {
        "minimal": {"step": 0, "hashes": {}},
        "full": {"step": 1024, "hashes": {"plant": "00ff" * 16, "controller": "5a" * 32}},
        "before the first step": {"step": -1, "hashes": {_UNICODE: ""}},
    },
    "Log/1": {
        "minimal": {"name": "plant", **_RUN},
        "full": {
            "name": "controller",
            **_RUN,
            "outputs": [
                {**_RUN, "step": 0, "t_ns": 0},
                {
                    **_STEP_1,
                    "ports": {"command": _PORTS["JointCommand/1"]["full"]},
                },
            ],
            "timing": [[0, 120000, 45000], [1, 0, 2**53 + 1]],
            "waiting": {"step": 2, "sources": ["mission", "plant"]},
            "drops": {"duplicate": 1, "stale": 300},
        },
        "waiting for the trigger": {
            "name": "plant",
            **_RUN,
            "waiting": {"step": 64, "sources": []},
        },
    },
}

_ENDING: dict[str, dict[str, Value]] = {
    "Fault/1": {
        "minimal": {"name": "plant", **_RUN, "step": 0, "type": "raised", "message": ""},
        "full": {
            "name": "controller",
            **_RUN,
            "step": 412,
            "type": "message",
            "message": "plant published no JointState/1",
            "traceback": "Traceback (most recent call last):\n  …",
            "blames": "plant",
        },
        "before the first step": {
            "name": "plant",
            **_RUN,
            "step": -1,
            "type": "wiring",
            "message": _UNICODE,
        },
    },
    "Stop/1": {
        "minimal": {**_RUN, "reason": "", "at_step": 0},
        "full": {**_RUN, "reason": "the duration is over", "at_step": 2000},
        "now": {**_RUN, "reason": "Ctrl-C", "at_step": -1},
        "smallest integer": {**_RUN, "reason": _UNICODE, "at_step": -(2**63)},
    },
}

_CALLING: dict[str, dict[str, Value]] = {
    "Call/1": {
        "minimal": {**_RUN, "id": 0, "method": ""},
        "full": {**_RUN, "id": 7, "method": "set_joint_position", "args": ["elbow", -0.5]},
    },
    "CallRecord/1": {
        "minimal": {"step": 0, "participant": "plant", "method": "reset"},
        "full": {
            "step": 120,
            "participant": "plant",
            "method": "set_joint_position",
            "args": ["elbow", 9.5],
            "error": "elbow cannot be put to 9.5; its limits are [-2.5, 2.5]",
        },
    },
    "CallReply/1": {
        "minimal": {},
        "full": {"step": 120, "value": {"elbow": -0.5, "names": [_UNICODE, None]}},
        "error": {"error": "no participant 'plnt'; did you mean 'plant'?"},
    },
    "CallRequest/1": {
        "minimal": {**_RUN},
        "full": {**_RUN, "participant": "plant", "method": "joint_position", "args": ["elbow"]},
    },
    "Called/1": {
        "minimal": {"name": "plant", **_RUN, "id": 0},
        "full": {"name": "plant", **_RUN, "id": 7, "value": [0.1, 2**53 + 1, True]},
        "error": {"name": "plant", **_RUN, "id": 8, "error": _UNICODE},
    },
}

EXAMPLES: dict[str, dict[str, Value]] = {
    **_PORTS,
    **_JOINING,
    **_STEPPING,
    **_CALLING,
    **_ENDING,
}
"""Type name → name of the example → value."""
