"""Ghosts of targets: shown where they differ from what is measured."""

import types

import pytest

from stepbus_tools.viewing.scene.pose import Pose, about
from stepbus_tools.viewing.stage.stage import Ghosts

Z = (0.0, 0.0, 1.0)


@pytest.fixture
def mesh():
    return types.SimpleNamespace(visible=True)


@pytest.fixture
def ghosts(mesh):
    return Ghosts({"target/arm/link": [mesh]})


def poses(x=0.0, yaw=0.0):
    return {"arm/link": Pose(), "target/arm/link": Pose((x, 0.0, 0.0), about(Z, yaw))}


@pytest.mark.parametrize("far", [poses(x=0.02), poses(yaw=0.03), {"target/arm/link": Pose()}])
def test_a_ghost_is_shown_where_its_link_is_not(ghosts, mesh, far):
    ghosts.compare(poses())
    assert not mesh.visible
    ghosts.compare(far)
    assert mesh.visible


def test_a_ghost_does_not_flicker(ghosts, mesh):
    ghosts.compare(poses(x=0.007))
    assert mesh.visible
    ghosts.compare(poses(x=0.004))
    ghosts.compare(poses(x=0.007))
    assert not mesh.visible


def test_ghosts_that_are_switched_off_stay_so(ghosts, mesh):
    ghosts.show(visible=False)
    ghosts.compare(poses())
    ghosts.compare(poses(x=0.1))
    assert not mesh.visible
    ghosts.show(visible=True)
    assert mesh.visible
