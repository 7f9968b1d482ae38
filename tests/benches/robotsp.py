"""The public task of RoboTSP as plain files, for tests/benches/robotsp.rs: python robotsp.py ROBOTSP RAVEUTILS OUT, the
checkouts of github.com/crigroup/robotsp and crigroup/raveutils (both BSD-like). Writes OUT/task.json (targets and the
subsets that its benchmark draws, limits, home, bodies of the drill and of the world, published figures), OUT/arm.urdf with
its meshes, and OUT/jig.stl. Needs numpy and h5py.
"""

import json
import struct
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import h5py
import numpy as np

MM = 1000.0
# scripts/run_benchmarks.py
COLUMNS = [25, 50, 100, 150, 200, 245]
SPEEDS_RAD_PER_S = [1.0, 0.7, 0.7, 1.0, 0.7, 1.57]
ACCELERATIONS_RAD_PER_S2 = [5.0, 4.25, 4.25, 5.25, 6.0, 8.0]
HOME_DEG = [0.0, -20.0, 130.0, 0.0, 70.0, 0.0]
STANDOFF_MM = 10.0
STEP_DEG = 45.0
# Metres: of the triangles that the arm's links are cut into, and of the pieces along z that get capsules of their own. The
# upper arm and the forearm need them to be clear of each other at home. The flange's disc, 9 mm from the forearm's fork there,
# has none: the coupling in front of it is wider.
LONGEST_EDGE = 0.03
PIECES = {0: 1.0, 1: 1.0, 2: 0.1, 3: 1.0, 4: 0.1, 5: 1.0}


def numbers(element):
    return [float(word) for word in (element.text or "").split()]


def turned(axis, degrees):
    """Rotation about an axis, Rodrigues."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.deg2rad(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def own_pose(element):
    """OpenRAVE's XML: rotations in the order written, each in the outer frame, then all translations."""
    pose = np.eye(4)
    for child in element:
        if child.tag.lower() == "rotationaxis":
            *axis, degrees = numbers(child)
            pose[:3, :3] = turned(axis, degrees) @ pose[:3, :3]
        elif child.tag.lower() == "translation" and (child.text or "").strip():
            pose[:3, 3] += numbers(child)
    return pose


def written(pose):
    """As a specification has it: millimetres and a unit quaternion."""
    r = pose[:3, :3]
    q = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + np.trace(r)])
    if q[3] < 1e-6:
        # Half a turn: the column of r + 1 that is longest.
        columns = r + np.eye(3)
        q = np.append(columns[:, np.argmax(np.linalg.norm(columns, axis=0))], 0.0)
    return {"translation_mm": (pose[:3, 3] * MM).tolist(), "quaternion_xyzw": (q / np.linalg.norm(q)).tolist()}


def shapes(body, name, pose):
    """The boxes and cylinders of a body that stands at `pose`."""
    for index, geom in enumerate(body.findall("geom")):
        at = pose @ own_pose(geom)
        if geom.get("type") == "box":
            shape = {"kind": "box", "size_mm": [2 * MM * x for x in numbers(geom.find("extents"))]}
        elif geom.get("type") == "cylinder":
            # OpenRAVE's stand along y, ours along z.
            at = at @ np.block([[turned([1, 0, 0], -90), np.zeros((3, 1))], [np.zeros((1, 3)), 1]])
            radius, height = numbers(geom.find("radius"))[0], numbers(geom.find("height"))[0]
            shape = {"kind": "cylinder", "radius_mm": radius * MM, "height_mm": height * MM}
        else:
            continue
        yield {"name": f"{name} {index + 1}", "owner_from_body": written(at), "shape": shape}


def world(data):
    """What stands around, the pose of the panel and where its holes are."""
    environment = ElementTree.parse(data / "worlds/airbus_challenge.env.xml").getroot()
    bodies, holes, jig = [], [], None
    for entry in environment.findall("kinbody"):
        at = own_pose(entry)
        for body in ElementTree.parse(data / entry.get("file")).getroot().findall("body"):
            pose = at @ own_pose(body)
            name = body.get("name")
            if name is not None and name.startswith("hole"):
                holes.append(np.concatenate([pose[:3, 3], pose[:3, 2]]))
            elif body.get("enable") != "false":
                bodies += shapes(body, name or entry.get("file").split("/")[-1].split(".")[0], pose)
            mesh = body.find("geom/data")
            if mesh is not None:
                jig = (mesh.text.split(), pose @ own_pose(body.find("geom")))
    return bodies, np.array(holes), jig


def tool(data):
    """The bodies that the flange carries and the drill's tip, in its frame."""
    robot = ElementTree.parse(data / "robots/denso_driller.robot.xml").getroot()
    poses, bodies = {"link6": np.eye(4)}, []
    for entry in robot.findall("Kinbody"):
        first = entry.find("body")
        for body in ElementTree.parse(data / entry.get("file")).getroot().findall("body"):
            name = body.get("name")
            held_by = first if name == first.get("name") else body
            poses[name] = poses[held_by.find("offsetfrom").text] @ own_pose(held_by)
            bodies += shapes(body, name, poses[name])
        bodies += shapes(first, f"{first.get('name')} casing", poses[first.get("name")])
    drill = next(m for m in robot.findall("Manipulator") if m.get("name") == "drill")
    return bodies, poses[drill.find("effector").text] @ own_pose(drill)


def stl(path, triangles):
    """Binary, the numbers as they are."""
    with open(path, "wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(triangles)))
        for triangle in triangles:
            file.write(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0))


def arm(data, out):
    """The arm's COLLADA file as a URDF: OpenRAVE writes each joint as a step, turned so that its axis is z, and back."""
    space = "{http://www.collada.org/2008/03/COLLADASchema}"
    root = ElementTree.parse(data / "robots/denso_vs060.dae").getroot()
    model = root.find(f".//{space}kinematics_model/{space}technique_common")
    limits = [[np.deg2rad(float(joint.find(f".//{space}{end}").text)) for end in ("min", "max")]
              for joint in model.findall(f"{space}joint")]
    node, text, number = root.find(f".//{space}node[@sid='node0']"), "", 0
    while node is not None:
        text += link(root, space, node, number, out)
        inner = node.find(f"{space}node")
        if inner is not None:
            step = [numbers(child) for child in inner if child.tag == f"{space}translate"][0]
            axis, degrees = np.split(np.array([numbers(c) for c in inner if c.tag == f"{space}rotate"][0]), [3])
            along = turned(axis, degrees[0]) @ [0, 0, 1]
            low, high = limits[number]
            text += (f'<joint name="joint{number + 1}" type="revolute"><parent link="link{number}"/>'
                     f'<child link="link{number + 1}"/><origin xyz="{" ".join(f"{x:.9g}" for x in step)}" rpy="0 0 0"/>'
                     f'<axis xyz="{" ".join(f"{x:.9g}" for x in along)}"/><limit lower="{low}" upper="{high}" effort="0" '
                     f'velocity="{SPEEDS_RAD_PER_S[number]}"/></joint>\n')
        node, number = inner, number + 1
    (out / "arm.urdf").write_text(f'<robot name="vs060">\n{text}</robot>\n', encoding="utf-8")


def pieces(triangles, length):
    """The triangles cut small and sorted into pieces along z, each about so long."""
    while True:
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = edges.max(axis=1) > LONGEST_EDGE
        if not long.any():
            break
        a, b, c = np.moveaxis(triangles[long], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([triangles[~long]] + [np.stack(part, axis=1) for part in parts])
    low, high = triangles[..., 2].min(), triangles[..., 2].max()
    count = int(np.ceil((high - low) / length))
    number = ((triangles[..., 2].mean(axis=1) - low) / (high - low) * count).astype(int).clip(0, count - 1)
    return [triangles[number == k] for k in range(count) if (number == k).any()]


def link(root, space, node, number, out):
    """A link, and hanging on it the pieces of all its geometries, whose triangles have three corners of their own each."""
    triangles = []
    for instance in node.findall(f"{space}instance_geometry"):
        geometry = root.find(f".//{space}geometry[@id='{instance.get('url')[1:]}']")
        corners = np.array(numbers(geometry.find(f".//{space}float_array"))).reshape(-1, 3)
        triangles.append(corners[np.array(numbers(geometry.find(f".//{space}p")), int)].reshape(-1, 3, 3))
    text = f'<link name="link{number}"/>\n'
    cut = pieces(np.concatenate(triangles), PIECES[number]) if number in PIECES else []
    for index, part in enumerate(cut):
        name = f"link{number}_{index + 1}"
        stl(out / f"{name}.stl", part)
        text += (f'<link name="{name}"><collision><geometry><mesh filename="{name}.stl"/></geometry></collision></link>'
                 f'<joint name="to_{name}" type="fixed"><parent link="link{number}"/><child link="{name}"/></joint>\n')
    return text


def main():
    robotsp, raveutils, out = map(Path, sys.argv[1:])
    data = raveutils / "data"
    out.mkdir(parents=True, exist_ok=True)
    arm(data, out)
    bodies, holes, ((file, scale), jig) = world(data)
    drill, flange_from_tip = tool(data)
    raw = (data / "objects" / file).read_bytes()
    count = struct.unpack_from("<I", raw, 80)[0]
    facets = np.frombuffer(raw, np.dtype([("f", "<f4", (4, 3)), ("attribute", "<u2")]), count, 84)["f"][:, 1:].astype(float)
    stl(out / "jig.stl", (facets * float(scale)) @ jig[:3, :3].T * MM + jig[:3, 3] * MM)
    with h5py.File(robotsp / "data/benchmarks.hdf5") as file:
        targets = file["targets"][()]
        published = {name.decode(): {"cpu_secs": cpu.tolist(), "execution_secs": run.tolist()} for name, cpu, run in
                     zip(file["others/methods"], file["others/cpu_time"], file["others/execution_time"])}
        configurations = file["discretization/number_of_configurations"][3].tolist()
    assert np.allclose(targets, holes, atol=1e-9), "the world's holes are not the targets"
    drawn = np.random.RandomState(1)
    subsets = [drawn.choice(len(targets), size=n, replace=False).tolist() for n in COLUMNS]
    # JSON has no infinity: a failure is null.
    for figures in published.values():
        for key, values in figures.items():
            figures[key] = [value if np.isfinite(value) else None for value in values]
    task = {
        "targets": [{"position_mm": (t[:3] * MM).tolist(), "direction": t[3:].tolist()} for t in targets],
        "subsets": subsets,
        "accelerations_rad_per_s2": ACCELERATIONS_RAD_PER_S2,
        "home_deg": HOME_DEG,
        "standoff_mm": STANDOFF_MM,
        "step_deg": STEP_DEG,
        "flange_from_tip": written(flange_from_tip),
        "tool": drill,
        "obstacles": bodies,
        "published": published,
        "published_configurations": configurations,
    }
    (out / "task.json").write_text(json.dumps(task, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
