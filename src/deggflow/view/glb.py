"""A MuJoCo model as a GLB file (glTF 2.0): bodies, colours and cameras, for viewers and browsers.

A GLB file is a JSON chunk that describes nodes, meshes and materials, and a chunk with their numbers. Each
body is a node with its geoms as children; geoms of one shape share their vertices. glTF's y points up: one
node turns the model, whose own z does.
"""

import json
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .stage import import_mujoco

TYPE = "model/gltf-binary"  # media type

_UPRIGHT = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # quaternion x, y, z, w: z of the model to y of glTF
_SLICES, _STACKS = 40, 20  # of round shapes, as MuJoCo's own pictures have
_FLOAT, _UINT = 5126, 5125  # glTF's component types
_VERTICES, _INDICES = 34962, 34963  # and its targets of buffer views
_SMOOTH = np.cos(np.radians(40.0))  # of the angle between faces that are shaded as one
_HIDDEN = 3  # first group of geoms that MuJoCo's own viewer hides


class Surface(NamedTuple):
    """Triangles, seen from the side on which their corners turn counter-clockwise.

    Attributes:
        points: m.
        normals: Unit vectors outwards.
        faces: Three points each.
    """

    points: Float[np.ndarray, "points 3"]
    normals: Float[np.ndarray, "points 3"]
    faces: Int[np.ndarray, "faces 3"]


def model_glb(model: Any, data: Any) -> bytes:
    """The model as it stands.

    Args:
        model: MuJoCo's model.
        data: Its state; bodies and cameras are where its positions put them.

    Returns:
        The file's bytes. Nodes are named after bodies and cameras; geoms that are invisible are left out.

    Raises:
        ValueError: The model has a geom of another shape than box, sphere, ellipsoid, cylinder, capsule or mesh.
    """
    mujoco = import_mujoco()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    file = _File()
    for body in range(model.nbody):
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        geoms = [k for k in range(first, first + count) if _is_visible(model, k)]
        children = [node for k in geoms for node in _geom_nodes(mujoco, model, k, file)]
        if children:
            name = model.body(body).name
            place = {"translation": _floats(data.xpos[body]), "rotation": _xyzw(data.xquat[body])}
            file.top.append(file.node({"name": name, "children": children, **place}))
    for camera in range(model.ncam):
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, data.cam_xmat[camera])
        lens = {"yfov": float(np.radians(model.cam_fovy[camera])), "znear": 0.01}
        place = {"translation": _floats(data.cam_xpos[camera]), "rotation": _xyzw(turn)}
        file.cameras.append({"type": "perspective", "perspective": lens})
        named = {"name": model.camera(camera).name, "camera": camera}
        file.top.append(file.node({**named, **place}))
    return file.content()


def _is_visible(model: Any, geom: int) -> bool:
    return bool(model.geom_rgba[geom, 3] > 0 and model.geom_group[geom] < _HIDDEN)


def _geom_nodes(mujoco: Any, model: Any, geom: int, file: "_File") -> list[int]:
    """The nodes that draw a geom: one, or a capsule's cylinder and its two ends."""
    shape, size = mujoco.mjtGeom(model.geom_type[geom]), _floats(model.geom_size[geom])
    at, turn = model.geom_pos[geom], model.geom_quat[geom]
    colour = tuple(_floats(model.geom_rgba[geom]))
    kinds = mujoco.mjtGeom

    def node(surface: str, scale: list[float], place: Float[np.ndarray, " 3"] = at) -> int:
        mesh = file.mesh(surface, lambda: _UNITS[surface], colour)
        pose = {"translation": _floats(place), "rotation": _xyzw(turn), "scale": scale}
        return file.node({"mesh": mesh, **pose})

    if shape == kinds.mjGEOM_BOX:
        return [node("box", size)]
    if shape == kinds.mjGEOM_SPHERE:
        return [node("ball", 3 * size[:1])]
    if shape == kinds.mjGEOM_ELLIPSOID:
        return [node("ball", size)]
    if shape == kinds.mjGEOM_CYLINDER:
        return [node("drum", [size[0], size[0], size[1]])]
    if shape == kinds.mjGEOM_CAPSULE:
        axis = np.empty(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), turn)
        ends = [node("ball", 3 * size[:1], at + sign * axis) for sign in (-1, 1)]
        return [node("drum", [size[0], size[0], size[1]]), *ends]
    if shape == kinds.mjGEOM_MESH:
        number = int(model.geom_dataid[geom])
        mesh = file.mesh(f"mesh {number}", lambda: _mesh_surface(model, number), colour)
        return [file.node({"mesh": mesh, "translation": _floats(at), "rotation": _xyzw(turn)})]
    raise ValueError(
        f"`model` must have boxes, spheres, ellipsoids, cylinders, capsules and meshes alone; got {shape.name}."
    )


def _mesh_surface(model: Any, number: int) -> Surface:
    """A mesh of the model. MuJoCo's own normals point inwards at some edges of thin solids."""
    faces = _rows(model.mesh_face, model.mesh_faceadr, model.mesh_facenum, number)
    points = _rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum, number)
    first, second, third = np.moveaxis(points[faces].astype(np.float64), 1, 0)
    across = np.cross(second - first, third - first)
    area = np.linalg.norm(across, axis=-1)
    kept = area > 1e-12
    faces, area, flat = faces[kept], area[kept], across[kept] / area[kept, None]
    corner, owner = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
    # At a corner, faces that meet at small angles are shaded as one.
    meets = np.zeros((len(points), len(faces)), bool)
    meets[corner, owner] = True
    smooth = meets[corner] & (flat @ flat.T > _SMOOTH)[owner]
    normals = smooth @ (area[:, None] * flat)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rows = np.concatenate([points[corner], np.round(normals, 4)], axis=-1)
    unique, index = np.unique(rows, axis=0, return_inverse=True)
    return Surface(unique[:, :3], unique[:, 3:], index.reshape(-1, 3))


def _rows(values: Any, first: Any, count: Any, number: int) -> Any:
    return values[int(first[number]) : int(first[number]) + int(count[number])]


def _box() -> Surface:
    points: list[Any] = []
    normals: list[Any] = []
    faces: list[Any] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = sign
            first, second = np.roll(np.eye(3), -axis, axis=0)[1:]
            second = sign * second  # first x second points outwards
            faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(faces))
            points += [normal + u * first + v * second for u, v in _SQUARE]
            normals += [normal] * 4
    return Surface(np.array(points), np.array(normals), np.concatenate(faces))


_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def _around() -> Float[np.ndarray, "points 2"]:
    angles = np.linspace(0.0, 2 * np.pi, _SLICES + 1)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _strips(rows: int) -> Int[np.ndarray, "faces 3"]:
    """Triangles between rows of points, each of one more than `_SLICES`, from the lowest to the highest."""
    wide = _SLICES + 1
    here = (wide * np.arange(rows - 1)[:, None] + np.arange(_SLICES)).ravel()
    lower = np.stack([here, here + 1, here + 1 + wide], axis=-1)
    return np.concatenate([lower, np.stack([here, here + 1 + wide, here + wide], axis=-1)])


def _ball() -> Surface:
    up = np.linspace(-np.pi / 2, np.pi / 2, _STACKS + 1)
    flat = np.cos(up)[:, None, None] * _around()
    high = np.broadcast_to(np.sin(up)[:, None, None], (*flat.shape[:2], 1))
    points = np.concatenate([flat, high], axis=-1).reshape(-1, 3)
    faces = _strips(_STACKS + 1)
    corners = points[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1
    )
    return Surface(points, points, faces[area > 1e-9])  # at the poles, half of them are lines


def _drum() -> Surface:
    around, count = _around(), _SLICES + 1
    low, high = (np.column_stack([around, np.full(count, z)]) for z in (-1.0, 1.0))
    outward = np.column_stack([around, np.zeros(count)])
    fan = np.stack([np.zeros(_SLICES - 2, int), *(np.arange(k, _SLICES - 2 + k) for k in (1, 2))])
    caps = [fan[[0, 2, 1]].T + 2 * count, fan.T + 3 * count]
    down = np.broadcast_to([0.0, 0.0, -1.0], low.shape)
    normals = np.concatenate([outward, outward, down, -down])
    return Surface(
        np.concatenate([low, high, low, high]), normals, np.concatenate([_strips(2), *caps])
    )


_UNITS = {"box": _box(), "ball": _ball(), "drum": _drum()}  # half extents and radii of 1


class _File:
    """A GLB file that is being put together."""

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = []
        self.top: list[int] = []
        self.cameras: list[dict[str, Any]] = []
        self._meshes: dict[tuple[str, tuple[float, ...]], int] = {}
        self._primitives: dict[str, dict[str, Any]] = {}
        self._materials: dict[tuple[float, ...], int] = {}
        self._json: dict[str, list[Any]] = {
            name: [] for name in ("meshes", "materials", "accessors", "bufferViews")
        }
        self._bytes = bytearray()

    def node(self, node: dict[str, Any]) -> int:
        """Adds a node; its number."""
        self.nodes.append(node)
        return len(self.nodes) - 1

    def mesh(self, name: str, make: Callable[[], Surface], colour: tuple[float, ...]) -> int:
        """The number of the mesh of a surface, by its name, in a colour; `make` is called once for a name."""
        key = name, colour
        if key not in self._meshes:
            if name not in self._primitives:
                surface = make()
                attributes = {
                    "POSITION": self._accessor(surface.points, "VEC3", bounds=True),
                    "NORMAL": self._accessor(surface.normals, "VEC3"),
                }
                indices = self._accessor(surface.faces.ravel(), "SCALAR")
                self._primitives[name] = {"attributes": attributes, "indices": indices}
            primitive = {**self._primitives[name], "material": self._material(colour)}
            self._json["meshes"].append({"name": name, "primitives": [primitive]})
            self._meshes[key] = len(self._json["meshes"]) - 1
        return self._meshes[key]

    def _material(self, colour: tuple[float, ...]) -> int:
        if colour not in self._materials:
            shine = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
            linear = [*map(_linear, colour[:3]), colour[3]]  # glTF's colours are linear
            material = {"pbrMetallicRoughness": {"baseColorFactor": linear, **shine}}
            blend = {"alphaMode": "BLEND"} if colour[3] < 1 else {}
            self._json["materials"].append({**material, **blend})
            self._materials[colour] = len(self._materials)
        return self._materials[colour]

    def _accessor(self, values: np.ndarray, kind: str, *, bounds: bool = False) -> int:
        whole = np.issubdtype(values.dtype, np.integer)
        content = values.astype("<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": content.nbytes}
        self._json["bufferViews"].append({**view, "target": _INDICES if whole else _VERTICES})
        self._bytes += content.tobytes()
        accessor = {
            "bufferView": len(self._json["bufferViews"]) - 1,
            "componentType": _UINT if whole else _FLOAT,
            "count": len(content),
            "type": kind,
        }
        if bounds:
            accessor.update(min=_floats(content.min(axis=0)), max=_floats(content.max(axis=0)))
        self._json["accessors"].append(accessor)
        return len(self._json["accessors"]) - 1

    def content(self) -> bytes:
        """The file's bytes."""
        root = self.node({"name": "model", "rotation": _UPRIGHT, "children": self.top})
        parts = {"nodes": self.nodes, "cameras": self.cameras, **self._json}
        whole = {
            "asset": {"version": "2.0", "generator": "deggflow"},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
            "buffers": [{"byteLength": len(self._bytes)}],
            **{name: rows for name, rows in parts.items() if rows},
        }
        text = json.dumps(whole, separators=(",", ":"), allow_nan=False).encode()
        chunks = _chunk(b"JSON", text, b" ") + _chunk(b"BIN\0", bytes(self._bytes), b"\0")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: bytes, content: bytes, padding: bytes) -> bytes:
    padded = content + padding * (-len(content) % 4)
    return struct.pack("<I4s", len(padded), kind) + padded


def _linear(value: float) -> float:
    """A colour's part in linear light, of one in sRGB."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _xyzw(quaternion: Float[np.ndarray, " 4"]) -> list[float]:
    """MuJoCo's quaternions begin with the real part, glTF's end with it."""
    unit = np.asarray(quaternion, np.float64)
    return _floats(np.roll(unit / np.linalg.norm(unit), -1))


def _floats(values: Any) -> list[float]:
    return [round(float(each), 6) + 0.0 for each in np.asarray(values, np.float64)]
