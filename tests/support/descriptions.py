"""Descriptions of robots as users might have them, written as text."""

from tests.support.paths import ARM4

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'

# A mesh in the text format of STL.
TRIANGLE = """solid t
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid t
"""

# A MuJoCo file of three joints with a keyframe called home.
MJCF = """<mujoco model="mjarm">
  <compiler angle="radian" meshdir="meshes"/>
  <option gravity="0 0 -1.62"/>
  <asset><mesh name="shell" file="shell.stl"/><mesh name="rib" file="rib.stl"/></asset>
  <worldbody><body name="base" pos="0 0 0.1">
    <geom type="box" size="0.1 0.1 0.1" mass="2"/>
    <body name="link1" pos="0 0 0.2">
      <joint name="j1" axis="0 0 1" range="-3 3" armature="0.1"
             actuatorfrcrange="-7 7"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.05"/>
      <body name="link2" pos="0 0 0.3">
        <joint name="j2" axis="0 1 0" range="-2 2"/>
        <inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04"/>
        <geom type="mesh" mesh="shell"/><geom type="mesh" mesh="rib"/>
        <body name="link3" pos="0.4 0 0">
          <joint name="j3" axis="0 1 0" range="-2 2"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
          <body name="tip" pos="0.3 0 0"><geom type="sphere" size="0.03"/></body>
        </body>
      </body>
    </body>
  </body></worldbody>
  <keyframe><key name="stretched" qpos="0 0 0"/><key name="home" qpos="0.1 -0.5 0.9"/></keyframe>
</mujoco>"""


def arm4(tmp_path, *replacements):
    """Write arm4.urdf with each (old, new) replaced and return its path."""
    text = ARM4.read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "arm4.urdf"
    path.write_text(text)
    return path
