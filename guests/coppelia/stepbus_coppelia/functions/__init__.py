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
addForce addForceAndTorque addGraphCurve addGraphStream addStatusbarMessage
alphaBetaGammaToYawPitchRoll auxiliaryConsoleOpen auxiliaryConsolePrint broadcastMsg checkDistance
checkProximitySensor checkVisionSensor closeScene copyPasteObjects createForceSensor createJoint
createMeshShape createPath createProximitySensor createScript createVisionSensor destroyCollection
executeScriptString getArrayParam getContactInfo getExplicitHandling getInt32Parameter
getJointInterval getJointType getMatrixInverse getModelProperty getObjectChild getObjectIntParam
getObjectName getObjectSel getObjects getPage getRotationAxis getScriptHandle getShapeBB
getShapeColor getShapeInertia getShapeMass getShapeMesh getShapeViz getStepping getSystemTime
getVisionSensorResolution groupShapes handleDynamics handleProximitySensor importMesh importShape
interpolateMatrices interpolatePoses matrixToPose moveToConfig moveToPose multiplyMatrices
multiplyPoses multiplyVector packDoubleTable packInt32Table packUInt16Table packUInt32Table
packUInt8Table poseToMatrix readCustomDataBlock readCustomStringData readCustomTableData
readForceSensor removeModel resetDynamicObject saveImage saveModel saveScene scaleObject
setArrayParam setExplicitHandling setGraphStreamValue setInt32Parameter setJointDependency
setJointInterval setJointMode setModelProperty setObjectIntParam setObjectName setObjectSel
setShapeInertia setVisionSensorImage transformBuffer transformImage ungroupShape unpackDoubleTable
unpackInt32Table unpackUInt16Table unpackUInt32Table unpackUInt8Table writeCustomDataBlock
writeCustomStringData writeCustomTableData yawPitchRollToAlphaBetaGamma
"""
UNAVAILABLE = frozenset(_MORE.split())
"""Further ones that scripts call: a client knows them, and their calls are errors by name."""
NAMES = {name for group in GROUPS for name in group.names()}
"""Of all functions, without `sim.`."""
