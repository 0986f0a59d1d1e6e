"""OpenGL's matrices for a picture of a world, taken from outside of it."""

import math

import numpy as np

from stepbus_plant.geometry import Array
from stepbus_schemas import Point


def view_matrix(target: Point, distance: float, yaw: float, pitch: float) -> Array:
    """Return the transform from the world to OpenGL's camera frame, shape (4, 4).

    target: the point in the middle [m]. distance: from it [m]. yaw, pitch: where the camera looks,
    counter-clockwise from y and upwards [rad].
    """
    sy, cy, sp, cp = math.sin(yaw), math.cos(yaw), math.sin(pitch), math.cos(pitch)
    ahead = np.array([-sy * cp, cy * cp, sp])
    # OpenGL's camera looks along -z, with x to the right and y up.
    turn = np.stack([np.array([cy, sy, 0.0]), np.array([sy * sp, -cy * sp, cp]), -ahead])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ (target - distance * ahead)
    return matrix


def projection_matrix(fov: float, aspect: float, near: float, far: float) -> Array:
    """Return OpenGL's projection matrix, shape (4, 4).

    fov: vertical field of view [rad]. aspect: width over height [-]. near, far: clipping [m].
    """
    scale = 1.0 / math.tan(fov / 2)
    matrix = np.diag([scale / aspect, scale, (far + near) / (near - far), 0.0])
    matrix[2, 3], matrix[3, 2] = 2 * far * near / (near - far), -1.0
    return matrix
