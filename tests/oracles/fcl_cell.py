"""A cell as FCL (the Flexible Collision Library) sees it, for collision_oracle.py and path_oracle.py: the arm's links where the
URDF's own chain puts them, and everything else as it was described. Nothing is taken from the planner but descriptions.

Description (JSON, millimetres, poses [x, y, z, i, j, k, w]): "urdf" a file; "base" and "tip" the links that are the foot and the
flange; "capsules" what stands for the links, or null for the URDF's own meshes, each {"name", "link": 0..6, "from", "to",
"radius"} in the base frame with all joints at zero; "base_from_table"; "bodies", each {"name", "on": "base" | "table" | "plate" |
"flange", "pose", "shape": {"box": [x, y, z]} | {"cylinder": [radius, height]} | {"capsule": [radius, length]} |
{"mesh": {"vertices", "faces"}}}. A configuration is six joint angles and the table's, radians."""
import json
import pathlib
import xml.etree.ElementTree as ElementTree

import fcl
import numpy as np
import trimesh

# Corners of what is round: inscribed, so that a contact of the polyhedron is one of the shape.
SECTIONS = 128
CAPSULE_SECTIONS = 32
# States of the arm in every one of which two links must touch to touch by construction.
JOINED_STATES = 100
# Points of a body that are looked for inside a convex one, whose surface may swallow it.
INNER_POINTS = 8


def pose(numbers):
    x, y, z, i, j, k, w = numbers
    return trimesh.transformations.translation_matrix([x, y, z]) @ trimesh.transformations.quaternion_matrix([w, i, j, k])


def turns(axis, angles):
    """Rotations about a unit axis, one a given angle (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sin, cos = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    matrices = np.tile(np.eye(4), (len(angles), 1, 1))
    matrices[:, :3, :3] = np.eye(3) + sin * cross + (1 - cos) * (cross @ cross)
    return matrices


class Arm:
    """The tree of a URDF, metres made millimetres."""

    def __init__(self, file, base, tip):
        self.folder = pathlib.Path(file).parent
        self.root = ElementTree.parse(file).getroot()
        self.joint_to = {joint.find("child").get("link"): joint for joint in self.root.findall("joint")}
        self.base, self.tip = base, tip
        self.moving = [joint for joint in self.way(tip) if joint.get("type") != "fixed"]
        assert len(self.moving) == 6 and all(joint.get("type") in ("revolute", "continuous") for joint in self.moving)

    def way(self, link):
        joints = []
        while link in self.joint_to:
            joints.append(self.joint_to[link])
            link = joints[-1].find("parent").get("link")
        return joints[::-1]

    @staticmethod
    def origin(element):
        at = element.find("origin")
        if at is None:
            return np.eye(4)
        xyz, rpy = ([float(v) for v in at.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
        matrix = trimesh.transformations.euler_matrix(*rpy, axes="sxyz")
        matrix[:3, 3] = 1000.0 * np.array(xyz)
        return matrix

    @staticmethod
    def limits(joint):
        limit = joint.find("limit")
        return (-np.pi, np.pi) if joint.get("type") == "continuous" else (float(limit.get("lower")), float(limit.get("upper")))

    def root_from(self, link, joints):
        at = np.tile(np.eye(4), (len(joints), 1, 1))
        for joint in self.way(link):
            at = at @ self.origin(joint)
            if joint in self.moving:
                axis = np.array([float(v) for v in joint.find("axis").get("xyz").split()])
                at = at @ turns(axis / np.linalg.norm(axis), joints[:, self.moving.index(joint)])
        return at

    def base_from(self, link, joints):
        return np.linalg.inv(self.root_from(self.base, joints)) @ self.root_from(link, joints)

    def carried(self):
        """Links that move with the arm alone: name and how many joints are before each."""
        for link in self.root.findall("link"):
            name = link.get("name")
            way = [joint for joint in self.way(name) if joint.get("type") != "fixed"]
            if way == self.moving[: len(way)]:
                yield link, len(way)

    def meshes(self):
        for link, number in self.carried():
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                file = self.folder / mesh.get("filename").removeprefix("package://")
                scale = [float(v) for v in mesh.get("scale", "1 1 1").split()]
                shape = trimesh.load_mesh(file)
                shape.apply_transform(self.origin(collision) @ np.diag([*(1000.0 * np.array(scale)), 1.0]))
                yield link.get("name"), number, shape


def solid(shape):
    """A shape that is convex as FCL's own of that kind, else nothing."""
    (kind, size), = shape.items()
    makers = {"box": fcl.Box, "cylinder": fcl.Cylinder, "capsule": fcl.Capsule}
    return makers[kind](*size) if kind in makers else None


def surface(shape):
    """A shape as triangles, and whether they bound something convex."""
    (kind, size), = shape.items()
    if kind == "box":
        return trimesh.creation.box(extents=size), True
    if kind == "cylinder":
        return trimesh.creation.cylinder(radius=size[0], height=size[1], sections=SECTIONS), True
    if kind == "capsule":
        mesh = trimesh.creation.capsule(radius=size[0], height=size[1], count=[CAPSULE_SECTIONS, CAPSULE_SECTIONS])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        return mesh, True
    return trimesh.Trimesh(np.array(size["vertices"]), np.array(size["faces"]), process=False), False


class Body:
    def __init__(self, name, on, mesh, convex, whole, body_from_whole):
        self.name, self.on = name, on
        self.centre = mesh.bounds.mean(axis=0)
        self.half = 0.5 * (mesh.bounds[1] - mesh.bounds[0])
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8)
        self.corners = self.centre[:, None] + self.half[:, None] * corners
        vertices = np.asarray(mesh.vertices)
        self.inner = vertices[:: max(1, len(vertices) // INNER_POINTS)]
        # Outward planes of what is convex: what is behind all of them is inside.
        self.planes = None
        if convex:
            normals = np.asarray(mesh.face_normals)
            self.planes = normals, np.einsum("ij,ij->i", normals, np.asarray(mesh.triangles)[:, 0])
        model = fcl.BVHModel()
        model.beginModel(len(mesh.faces), len(vertices))
        model.addSubModel(vertices, np.asarray(mesh.faces))
        model.endModel()
        self.object = fcl.CollisionObject(model, fcl.Transform())
        # The same as FCL's own shape, where it has one: quicker, and solid.
        self.solid, self.body_from_solid = (model, np.eye(4)) if whole is None else (whole, body_from_whole)

    def put(self, matrix):
        self.object.setTransform(fcl.Transform(matrix[:3, :3], matrix[:3, 3]))

    def swallows(self, mine, other, others):
        """Whether this convex body holds a point of the other."""
        if self.planes is None:
            return False
        to_mine = np.linalg.inv(mine) @ others
        points = other.inner @ to_mine[:3, :3].T + to_mine[:3, 3]
        normals, offsets = self.planes
        return bool((points @ normals.T <= offsets).all(axis=1).any())


class Cell:
    """Bodies, where they are, and which of them must not touch."""

    def __init__(self, spec):
        self.arm = Arm(spec["urdf"], spec["base"], spec["tip"])
        self.base_from_table = pose(spec["base_from_table"])
        zero = np.zeros((1, 6))
        self.bodies, self.owner_from_body = [], []
        self.link_names = {}
        for link, number in self.arm.carried():
            self.link_names.setdefault(number, link.get("name"))
        if spec["capsules"] is None:
            for name, number, mesh in self.arm.meshes():
                self.add(name, number, name, (mesh, False, None), np.eye(4))
        else:
            for capsule in spec["capsules"]:
                ends = np.array([capsule["from"], capsule["to"]])
                link = self.link_names[capsule["link"]]
                at = trimesh.geometry.align_vectors([0, 0, 1], ends[1] - ends[0]) if np.ptp(ends, axis=0).any() else np.eye(4)
                at[:3, 3] = ends.mean(axis=0)
                shape = {"capsule": [capsule["radius"], float(np.linalg.norm(ends[1] - ends[0]))]}
                at = np.linalg.inv(self.arm.base_from(link, zero)[0]) @ at
                self.add(capsule["name"], capsule["link"], link, (*surface(shape), solid(shape)), at)
        for body in spec["bodies"]:
            shape = body["shape"]
            self.add(body["name"], body["on"], body["on"], (*surface(shape), solid(shape)), pose(body["pose"]))
        self.pairs = [(a, b) for b in range(len(self.bodies)) for a in range(b) if self.may_meet(a, b)]
        joined = self.joined()
        self.pairs = [pair for pair in self.pairs if pair not in joined]
        self.left_out = [self.names(pair) for pair in joined]

    def add(self, name, on, owner, shape, owner_from_body):
        mesh, convex, whole = shape
        mesh = mesh.copy()
        mesh.apply_transform(owner_from_body)
        self.bodies.append(Body(name, on, mesh, convex, whole, owner_from_body))
        self.owner_from_body.append(owner)

    def may_meet(self, a, b):
        """Left out: neighbours in the chain, what is mounted to each other, and what stands still."""
        rank = {"base": 0, "table": 0, "flange": 6}
        a, b = self.bodies[a].on, self.bodies[b].on
        if "plate" in (a, b):
            return a != b and "table" not in (a, b)
        both_links = isinstance(a, int) and isinstance(b, int)
        return abs(rank.get(a, a) - rank.get(b, b)) > (1 if both_links else 0)

    def is_on_arm(self, body):
        return self.bodies[body].on == "flange" or isinstance(self.bodies[body].on, int)

    def joined(self):
        """Pairs of links whose meshes overlap however the arm stands."""
        low, high = np.array([self.arm.limits(joint) for joint in self.arm.moving] + [(0.0, 0.0)]).T
        states = np.random.default_rng(1).uniform(low, high, (JOINED_STATES, 7))
        placed = self.place(states)
        pairs = [pair for pair in self.pairs if all(isinstance(self.bodies[body].on, int) for body in pair)]
        return [(a, b) for a, b in pairs if all(self.touch(a, b, at_a, at_b) for at_a, at_b in zip(placed[a], placed[b]))]

    def place(self, configurations):
        """Base-from-owner of every body at every configuration."""
        joints = configurations[:, :6]
        plate = self.base_from_table @ turns([0, 0, 1], configurations[:, 6])
        still = np.ones((len(joints), 1, 1))
        fixed = {"base": np.eye(4) * still, "table": self.base_from_table * still, "plate": plate}
        fixed["flange"] = self.arm.base_from(self.arm.tip, joints)
        at = {}
        for owner in self.owner_from_body:
            if owner not in at:
                at[owner] = fixed[owner] if owner in fixed else self.arm.base_from(owner, joints)
        return [at[owner] for owner in self.owner_from_body]

    def gaps(self, placed):
        """For each pair and configuration: no less than this apart, by boxes."""
        centres = [m[:, :3, :3] @ body.centre + m[:, :3, 3] for body, m in zip(self.bodies, placed)]
        halves = [np.abs(m[:, :3, :3]) @ body.half for body, m in zip(self.bodies, placed)]
        for a, b in self.pairs:
            yield np.linalg.norm(np.maximum(np.abs(centres[a] - centres[b]) - halves[a] - halves[b], 0.0), axis=1)

    def touch(self, a, b, at_a, at_b):
        one, other = self.bodies[a], self.bodies[b]
        one.put(at_a)
        other.put(at_b)
        if fcl.collide(one.object, other.object, fcl.CollisionRequest(), fcl.CollisionResult()):
            return True
        return one.swallows(at_a, other, at_b) or other.swallows(at_b, one, at_a)

    def distance(self, a, b, at_a, at_b):
        one, other = self.bodies[a], self.bodies[b]
        one.put(at_a)
        other.put(at_b)
        return fcl.distance(one.object, other.object, fcl.DistanceRequest(), fcl.DistanceResult())

    def names(self, pair):
        return [self.bodies[body].name for body in pair]


def read_cell(line):
    return Cell(json.loads(line))
