"""Presses shapes into a pad in another program, with what `export-material` wrote for it.

Run by an interpreter that has the program: `python press_in.py` reads a task as JSON from standard input and
prints forces in N (MuJoCo: depths in m) as JSON. It imports nothing of this library.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any


def mujoco(task: dict[str, Any]) -> list[float]:
    """Depths at which a free body rests under forces, in m: MuJoCo computes penetration from force."""
    import mujoco as mj
    import numpy as np

    radius, half = task["radius_m"], task["length_m"] / 2
    geom = {
        "ball": f'type="sphere" size="{radius}"',
        "flat": f'type="cylinder" size="{radius} {2 * radius}"',
        "ridge": f'type="cylinder" size="{radius} {half}" euler="0 90 0"',
    }[task["shape"]]
    # three slides: body_invweight0 of one alone is a third of 1/mass; free bodies with several contacts tip over
    joint = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    top = 2 * radius if task["shape"] == "flat" else radius
    world = f"""<mujoco><include file="gel.xml"/><option timestep="0.0005" gravity="0 0 0"/><worldbody>
      <geom class="gel" type="box" size="0.05 0.05 0.0015" pos="0 0 -0.0015"/>
      <body pos="0 0 {top}">{joint}<geom {geom} mass="{task["mass_kg"]}"/></body></worldbody></mujoco>"""
    model = mj.MjModel.from_xml_string(world, {"gel.xml": task["text"].encode()})
    found = []
    for force in task["forces_N"]:
        data = mj.MjData(model)
        data.xfrc_applied[1, 2] = -force
        for _ in range(4000):
            mj.mj_step(model, data)
        if np.abs(data.qvel).max() > 1e-7:
            raise RuntimeError(f"the body did not come to rest: {data.qvel}")
        found.append(-float(data.qpos[2]))
    return found


def drake(task: dict[str, Any]) -> list[float]:
    """Forces in N at depths, of the contact results of a hydroelastic half space."""
    from pydrake.geometry import Cylinder, HalfSpace, Sphere
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
    from pydrake.multibody.tree import SpatialInertia, UnitInertia
    from pydrake.systems.framework import DiagramBuilder

    names: dict[str, Any] = {}
    exec(task["text"], names)  # noqa: S102 (what this library exported)
    radius, zero = task["radius_m"], [0, 0, 0]
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic"), builder)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "pad", names["gel"])
    body = plant.AddRigidBody("indenter", SpatialInertia(1.0, [0, 0, 0], UnitInertia.SolidSphere(radius)))
    shape, turn, above = Sphere(radius), RigidTransform(), radius
    if task["shape"] == "flat":
        shape, above = Cylinder(radius, 4 * radius), 2 * radius
    if task["shape"] == "ridge":
        shape, turn = (
            Cylinder(radius, task["length_m"]),
            RigidTransform(RotationMatrix.MakeYRotation(math.pi / 2), zero),
        )
    plant.RegisterCollisionGeometry(body, turn, shape, "indenter", names["indenter"])
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyMutableContextFromRoot(root := diagram.CreateDefaultContext())
    found = []
    for depth in task["depths_m"]:
        place = RigidTransform([0, 0, above - depth - task["offset_m"]])
        plant.SetFreeBodyPose(context, body, place)
        results = plant.get_contact_results_output_port().Eval(context)
        count = range(results.num_hydroelastic_contacts())
        found.append(sum(abs(results.hydroelastic_contact_info(i).F_Ac_W().translational()[2]) for i in count))
    del root
    return found


def genesis(task: dict[str, Any]) -> list[float]:
    """Forces in N at depths, the sum over a grid of KinematicTaxel probes."""
    import genesis as gs
    import numpy as np

    names: dict[str, Any] = {}
    exec(task["text"], names)  # noqa: S102 (what this library exported)
    gs.init(backend=gs.cpu, precision="64", logging_level="error")
    radius, pitch, thickness = task["radius_m"], task["pitch_m"], 3e-3
    half = 1.1 * math.sqrt(2 * radius * (max(task["depths_m"]) + task["offset_m"]))
    count = 2 * math.ceil(half / pitch) + 1
    x = (np.arange(count) - (count - 1) / 2) * pitch
    places = np.stack([*np.meshgrid(x, x), np.full((count, count), thickness / 2 + task["offset_m"])], axis=-1)
    scene = gs.Scene(sim_options=gs.options.SimOptions(dt=1e-5, gravity=(0, 0, 0)), show_viewer=False)
    pad = scene.add_entity(gs.morphs.Box(size=(0.03, 0.03, thickness), pos=(0, 0, -thickness / 2), fixed=True))
    ball = scene.add_entity(gs.morphs.Sphere(radius=radius, pos=(0, 0, radius + 1e-3)))
    sensor = scene.add_sensor(
        gs.sensors.KinematicTaxel(
            entity_idx=pad.idx, link_idx_local=0, probe_local_pos=places.tolist(), **names["KINEMATIC_TAXEL"]
        )
    )
    scene.build()
    found = []
    for depth in task["depths_m"]:
        ball.set_pos((0, 0, radius - depth))
        ball.zero_all_dofs_velocity()
        scene.step()
        force = np.asarray(sensor.read_ground_truth().force).reshape(-1, 3)
        found.append(float(abs(force[:, 2].sum())))
    return found


def tactile(task: dict[str, Any]) -> list[float]:
    """Penetration in m of the taxels of a square grid, row by row, by MuJoCo's tactile sensor, under a ball."""
    import mujoco as mj
    import numpy as np

    n, pitch, (x, y) = task["count"], task["pitch_m"], task["centre_m"]
    across, down = np.meshgrid(*(((np.arange(n) - (n - 1) / 2) * pitch),) * 2)
    top = np.stack([across.ravel(), down.ravel(), 0 * down.ravel()], axis=1)
    at = np.arange((n - 1) * n).reshape(n - 1, n)[:, :-1].ravel()
    upper = np.concatenate([np.stack([at, at + 1, at + n], 1), np.stack([at + 1, at + n + 1, at + n], 1)])
    line = np.arange(n)
    rim = np.concatenate([line[:-1], n * line[:-1] + n - 1, n * n - 1 - line[:-1], n * (n - 1) - n * line[:-1]])
    after = np.roll(rim, -1)
    sides = np.concatenate(
        [np.stack([rim, rim + n * n, after], 1), np.stack([after, rim + n * n, after + n * n], 1)]
    )
    faces = np.concatenate([upper, upper[:, ::-1] + n * n, sides])  # a block whose top vertices are the taxels
    vertices = np.concatenate([top, top - [0, 0, 3e-3]])

    def listed(numbers: Any) -> str:
        return " ".join(map(str, np.asarray(numbers).ravel()))

    model = mj.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="pad" vertex="{listed(vertices)}" face="{listed(faces)}"/></asset>
        <worldbody><geom name="pad" type="mesh" mesh="pad"/>
        <body pos="{x} {y} {task["radius_m"] - task["depth_m"]}"><freejoint/>
        <geom type="sphere" size="{task["radius_m"]}"/></body></worldbody>
        <sensor><tactile geom="pad" mesh="pad"/></sensor></mujoco>"""
    )
    data = mj.MjData(model)
    mj.mj_forward(model, data)
    return [float(depth) for depth in data.sensordata[: n * n]]


PRESSES = {"mujoco": mujoco, "drake": drake, "genesis": genesis, "tactile": tactile}

if __name__ == "__main__":
    given = json.load(sys.stdin)
    print(json.dumps(PRESSES[given["program"]](given)))
