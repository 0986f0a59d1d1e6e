"""What scripts call, one class for each kind of thing."""

from .joints import Joints
from .objects import Objects, Poses
from .other import Other, Signals
from .sensors import Sensors
from .simulation import Simulation
from .table import CONSTANTS as CONSTANTS
from .table import Group

GROUPS: tuple[type[Group], ...] = (Simulation, Objects, Poses, Joints, Sensors, Signals, Other)
_MORE = """
addForce addForceAndTorque addGraphCurve addGraphStream alphaBetaGammaToYawPitchRoll
auxiliaryConsoleOpen broadcastMsg copyPasteObjects createForceSensor createJoint createMeshShape
createPath createProximitySensor createScript createVisionSensor executeScriptString
getContactInfo getExplicitHandling getModelProperty getObjectSel getPage getRotationAxis
getShapeInertia getShapeMesh getShapeViz groupShapes handleDynamics importMesh importShape
interpolateMatrices interpolatePoses moveToConfig moveToPose readForceSensor resetDynamicObject
saveImage saveModel saveScene scaleObject setExplicitHandling setGraphStreamValue
setJointDependency setJointInterval setObjectSel setShapeInertia transformImage
ungroupShape yawPitchRollToAlphaBetaGamma
"""
UNAVAILABLE = frozenset(_MORE.split())
"""Further ones that scripts call: a client knows them, and their calls are errors by name."""
NAMES = {name for group in GROUPS for name in group.names()}
"""Of all functions, without `sim.`."""
