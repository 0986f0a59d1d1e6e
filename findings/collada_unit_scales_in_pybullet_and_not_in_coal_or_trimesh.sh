#!/usr/bin/env bash
# A COLLADA mesh in millimetres: PyBullet scales it to metres, coal (of Pinocchio) and trimesh leave it 1000 times as large.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet coal==3.0.3 trimesh==5.2.0 pycollada==0.9.3 pybullet==3.2.7 numpy==2.2.6
cat > "$folder/part.dae" <<'XML'
<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset>
  <created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
  <unit meter="0.001" name="millimeter"/><up_axis>Z_UP</up_axis>
 </asset>
 <library_geometries><geometry id="part"><mesh>
  <source id="points">
   <float_array id="numbers" count="12">0 0 0 1000 0 0 0 2000 0 0 0 3000</float_array>
   <technique_common><accessor source="#numbers" count="4" stride="3">
    <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
   </accessor></technique_common>
  </source>
  <vertices id="vertices"><input semantic="POSITION" source="#points"/></vertices>
  <triangles count="4">
   <input semantic="VERTEX" source="#vertices" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p>
  </triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="scene">
  <node id="node"><instance_geometry url="#part"/></node>
 </visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
XML
cat > "$folder/robot.urdf" <<'XML'
<robot name="part"><link name="part">
 <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
 <collision><geometry><mesh filename="part.dae"/></geometry></collision>
</link></robot>
XML
cat > "$folder/try.py" <<'PYTHON'
import coal
import numpy as np
import pybullet
import trimesh

pybullet.connect(pybullet.DIRECT)
points = pybullet.getMeshData(pybullet.loadURDF("robot.urdf"), -1)[1]
print("pybullet", np.round(np.max(points, axis=0), 3))
mesh = coal.MeshLoader().load("part.dae", np.ones(3))
mesh.computeLocalAABB()
print("coal", mesh.aabb_local.max_)
print("trimesh", trimesh.load("part.dae").bounds[1])
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr | grep -v '^pybullet build') | tee "$folder/seen"
echo "coal 3.0.3, trimesh 5.2.0 with pycollada 0.9.3, PyBullet 3.2.7"
echo "guess: all three read a part of 1 x 2 x 3 m, as the file's unit says"
echo "seen:  only PyBullet does; with the others it is 1000 x 2000 x 3000 m"
printf 'pybullet [1. 2. 3.]\ncoal [1000. 2000. 3000.]\ntrimesh [1000. 2000. 3000.]\n' | cmp - "$folder/seen"
