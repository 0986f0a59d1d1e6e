"""Links without inertials, and collisions of a body with itself."""

import pytest
from support.services.plant import LIMIT, make_plant

from stepbus_models import read_robot
from stepbus_participant import Endpoint, Ticket
from stepbus_plant.engines.pybullet import written
from stepbus_schemas import JointCommand, WiringError

BOX = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
CHAIN = f"""<robot name="chain">
<link name="root">{BOX}</link>
<link name="middle">{INERTIAL}</link>
<link name="hand">{INERTIAL}{BOX}</link>
<joint name="first" type="revolute"><parent link="root"/><child link="middle"/><axis xyz="0 0 1"/>{LIMIT}</joint>
<joint name="second" type="revolute"><parent link="middle"/><child link="hand"/><axis xyz="0 0 1"/>{LIMIT}</joint>
</robot>"""
"""Two boxes in one place, which are no neighbours; the root has no inertial."""


def plant_of(folder, pairs=None):
    (folder / "chain.urdf").write_text(CHAIN)
    srdf = ""
    if pairs is not None:
        rows = "".join(f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in pairs)
        (folder / "chain.srdf").write_text(f'<robot name="chain">{rows}</robot>')
        srdf = "srdf: chain.srdf, "
    return make_plant(folder, f"  c: {{urdf: chain.urdf, {srdf}fixed_base: true}}\n")


def contacts(plant):
    plant.physics.engine.update_shapes()
    return len(plant.physics.engine.contacts())


def test_links_collide_unless_their_pair_is_ruled_out(tmp_path):
    assert contacts(plant_of(tmp_path, [])) > 0
    assert contacts(plant_of(tmp_path, [("hand", "root")])) == 0


def test_without_an_srdf_the_links_of_a_body_pass_through_one_another(tmp_path):
    assert contacts(plant_of(tmp_path)) == 0


def test_a_link_of_an_srdf_that_the_model_lacks_is_refused_with_the_nearest_name(tmp_path):
    with pytest.raises(WiringError, match=r"link 'hnd' is unknown; .*'hand'"):
        plant_of(tmp_path, [("hnd", "root")])


def test_an_srdf_that_is_no_xml_is_refused(tmp_path):
    (tmp_path / "chain.srdf").write_text("<robot")
    (tmp_path / "chain.urdf").write_text(CHAIN)
    with pytest.raises(WiringError, match=r"cannot read .*chain.srdf"):
        make_plant(tmp_path, "  c: {urdf: chain.urdf, srdf: chain.srdf}\n")


def test_a_joint_that_moves_only_what_has_no_mass_moves_it_with_every_engine(tmp_path):
    nothing = '<mass value="0"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    text = CHAIN.replace(INERTIAL + BOX, f"<inertial>{nothing}</inertial>")
    (tmp_path / "chain.urdf").write_text(text)
    body = "{urdf: chain.urdf, fixed_base: true, joint_defaults: {mode: velocity}}"
    plant = make_plant(tmp_path, f"  c: {body}\n")
    command = JointCommand(mode="velocity", values=[0.5])
    plant.commander("command", ["second"]).apply(command)
    for _ in range(10):
        plant.advance()
    assert plant.sense().velocity == pytest.approx([0.0, 0.5], abs=1e-3)
    assert plant.physics.notes == []


def test_pybullet_refuses_more_joints_than_it_has_room_for_in_one_sentence(tmp_path):
    pytest.importorskip("pybullet")
    rows = [f'<link name="l{n}"/>' for n in range(129)]
    rows += [
        f'<joint name="j{n}" type="fixed"><parent link="l{n}"/><child link="l{n + 1}"/></joint>'
        for n in range(128)
    ]
    (tmp_path / "long.urdf").write_text(f'<robot name="long">{"".join(rows)}</robot>')
    sentence = r"long\.urdf: has 128 joints, .*takes 127; use `engine: mujoco`"
    with pytest.raises(WiringError, match=sentence):
        make_plant(tmp_path, "  c: {urdf: long.urdf, fixed_base: true}\nengine: pybullet\n")


def test_the_copy_of_a_model_is_in_the_private_folder_of_the_run(tmp_path, monkeypatch):
    """There it goes even when the plant is killed."""
    private = tmp_path / "private"
    private.mkdir()
    endpoint = Endpoint(listen=[f"unixsock-stream/{private}/1.sock"], connect=[])
    ticket = private / "plant.ticket"
    Ticket(run="run", name="plant", token="", endpoint=endpoint).save(ticket)
    monkeypatch.setenv("STEPBUS_TICKET", str(ticket))
    path = tmp_path / "half.urdf"
    path.write_text('<robot name="half"><link name="only"/></robot>')
    with written(read_robot(path)) as copy:
        assert copy.is_relative_to(tmp_path / "private")
