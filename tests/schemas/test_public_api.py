import importlib
from types import ModuleType

import pytest
from support.exports import exported

import stepbus_schemas

PACKAGES = [
    "stepbus_controller",
    "stepbus_kinematics",
    "stepbus_mission",
    "stepbus_orchestrator",
    "stepbus_plant",
    "stepbus_scenarios",
]


def _order(name: str) -> tuple[int, str]:
    """Sort as ruff does: constants, classes, functions."""
    return (0 if name.isupper() else 1 if name[0].isupper() else 2), name


def _own_names(package: ModuleType) -> set[str]:
    """Return the public classes and functions that a package defines, or takes from its modules."""
    return {
        name
        for name, value in vars(package).items()
        if not name.startswith("_")
        and str(getattr(value, "__module__", "")).startswith(package.__name__)
    }


@pytest.mark.parametrize("name", PACKAGES)
def test_all_is_sorted(name: str) -> None:
    listed = getattr(importlib.import_module(name), "__all__", [])
    assert listed == sorted(set(listed), key=_order)


@pytest.mark.parametrize("name", PACKAGES)
def test_all_is_complete(name: str) -> None:
    package = importlib.import_module(name)
    listed = set(getattr(package, "__all__", []))
    assert all(hasattr(package, item) for item in listed)  # some are imported when first used
    assert listed >= _own_names(package)


def test_the_contract_offers_exactly_this() -> None:
    assert " ".join(sorted(exported("stepbus_schemas"), key=_order)) == (
        "BRIDGE_FORMATS BRIDGE_VERSION CHAIN_EVERY ENVELOPE_TYPES HANDSHAKE_STEP MESSAGE_TYPES PROTOCOL_VERSION "
        "SHIPPED SPOKEN UNDECODABLE BaseCommand BaseState Batch BridgeFormat BytesMessage Call CallDescription CallRecord "
        "CallReply CallRequest Called CameraTrigger Chain Contacts ControllerStatus Declaration Decoder Description Detections "
        "EmergencyStop Envelope Event Fault Goal GoalState GoalStatus GoalType GripperCommand GripperState Hello Image Imu "
        "InputConfig JointCommand JointMode JointReference JointState LaserScan Log Message MessageError "
        "OutputConfig Outputs Plan PlanRequest Point PointCloud Poses Protocols Quaternion RawLayout Ready Refusal Row "
        "RunError Scalars SensedJoints Shape Spiral Start StepbusError Stop TextMessage Transforms Trigger Types "
        "Waiting Welcome WiringError Wrench class_declaration declaration_of declare differences due_step encode "
        "encode_in_parts encoding_of error_text explained field_docstrings fields_of json_schema listed meta nearest normal not_null offered parse_shapes "
        "parts_of raw_fields raw_problem reached reached_marks row_of suggest text_of type_name type_problems types_page types_vectors "
        "valid_unicode viewing wrong_word"
    )


def test_every_message_fits_a_map_header_of_one_byte():
    # Encoders write up to 15 fields with a header of one byte; more would change the bytes.
    counts = {
        name: len(kind.__struct_fields__) for name, kind in stepbus_schemas.MESSAGE_TYPES.items()
    }
    assert {name: count for name, count in counts.items() if count > 15} == {}
