"""The parts of an arm's motion, each fitted to the motors."""

from stepbus_kinematics import RobotModel
from stepbus_store.motion.manipulator.candidates import Candidate
from stepbus_store.motion.motions.fitting import fitted
from stepbus_store.motion.motions.joint_motion import MotionLimits
from stepbus_store.motion.motions.trajectory import AlongPath, Trajectory
from stepbus_store.motion.paths.follow import JointPath


class SegmentFitter:
    """Times the paths of a candidate, and slows motions down until the motors can follow.

    limits: of the joints. tip: limits along a path of the tip, shape (1,). effort_share: of the
    effort limits that motions may need.
    """

    def __init__(
        self, robot: RobotModel, limits: MotionLimits, tip: MotionLimits, effort_share: float
    ) -> None:
        self._robot = robot
        self._limits = limits
        self._tip = tip
        self._share = effort_share

    def along(self, candidate: Candidate) -> list[Trajectory]:
        """Return the motions along the paths of a candidate."""
        return [self.timed(path) for path in candidate.paths]

    def timed(self, path: JointPath) -> Trajectory:
        """Return the motion along one path."""
        return AlongPath(path, self._tip)

    def fitted(self, parts: list[Trajectory], duration: float) -> list[Trajectory]:
        """Return motions within the limits, together no shorter than a duration [s]."""
        within = [self._fitted(part) for part in parts]
        total = sum(part.duration for part in within)
        if not 0 < total < duration:
            return within
        return [self._fitted(part, part.duration * duration / total) for part in within]

    def _fitted(self, part: Trajectory, least_duration: float = 0.0) -> Trajectory:
        return fitted(
            part,
            self._robot,
            self._limits,
            effort_share=self._share,
            least_duration=least_duration,
        )
