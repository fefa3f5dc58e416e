"""GLB files hold what the MuJoCo model holds, read by an independent reader."""

import json
import struct
from io import BytesIO

import mujoco
import numpy as np
import pytest

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.library import LIBRARY
from deggflow.view.glb import model_glb
from deggflow.view.tabletop import scene_mjcf

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")

CLOSE = 0.02  # a body of 40 sides is so much smaller than a round one
Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@pytest.fixture(scope="module")
def compiled():
    """A scene of all types of objects, some of which are in each other's way, in MuJoCo."""
    names = tuple(kind.name for kind in LIBRARY)
    k = np.arange(len(names))
    poses = np.stack([0.3 * (k % 4) - 0.45, 0.25 * (k // 4) - 0.25, 0.3 * k], axis=-1)
    model = mujoco.MjModel.from_xml_string(scene_mjcf(SceneCondition(names, {}, 1.4, 0.94), poses))
    return model, mujoco.MjData(model)


@pytest.fixture(scope="module")
def content(compiled):
    return model_glb(*compiled)


@pytest.fixture(scope="module")
def scene(content):
    return trimesh.load_scene(BytesIO(content), file_type="glb")


def bodies(scene):
    """Names of the solids of each body."""
    graph = scene.graph.transforms
    tops = graph.children["model"]
    return {
        top: [each for each in graph.successors(top) if each in scene.graph.nodes_geometry]
        for top in tops
    }


def test_every_body_stands_where_mujoco_has_it(compiled, scene):
    _, data = compiled
    found = bodies(scene)
    assert {*found} >= {"table", *(kind.name for kind in LIBRARY)}
    for name in found:
        place, turn = data.body(name).xpos, data.body(name).xmat.reshape(3, 3)
        pose, _ = scene.graph.get(name)
        np.testing.assert_allclose(pose[:3, 3], Y_UP @ place, atol=1e-5)
        np.testing.assert_allclose(pose[:3, :3], Y_UP @ turn, atol=1e-5)


def test_every_surface_is_closed_and_faces_outwards(scene):
    for name, mesh in scene.geometry.items():
        joined = mesh.copy()
        joined.merge_vertices(merge_norm=True, merge_tex=True)
        assert joined.is_watertight, name
        assert joined.volume > 0, name
        along = np.einsum("ij,ij->i", mesh.face_normals, mesh.vertex_normals[mesh.faces[:, 0]])
        assert along.min() > np.cos(np.radians(45)), name


def test_bodies_are_as_large_as_in_mujoco(compiled, scene):
    """Their volumes are MuJoCo's masses, and each of their solids lies in the box that MuJoCo has around it."""
    model, _ = compiled
    for name, solids in bodies(scene).items():
        if not solids:
            continue
        volume = 0.0
        for solid in solids:
            pose, geometry = scene.graph.get(solid)
            volume += scene.geometry[geometry].volume * np.linalg.det(pose[:3, :3])
        mass = model.body(name).mass[0]
        # Capsules are drawn as a cylinder and two whole balls, half of each inside it.
        assert volume == pytest.approx(mass / 1000, rel=0.25), name
        assert volume > (1 - CLOSE) * mass / 1000


def test_the_file_is_valid_gltf(compiled, content):
    """Lengths and alignment as the format asks, colours with opacity blended, and cameras as in MuJoCo."""
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    file = json.loads(content[20 : 20 + size])
    assert (kind, size % 4) == (b"JSON", 0)
    assert file["buffers"] == [{"byteLength": len(content) - 28 - size}]
    assert all(view["byteOffset"] % 4 == 0 for view in file["bufferViews"])
    for material in file["materials"]:
        clear = material["pbrMetallicRoughness"]["baseColorFactor"][3] < 1
        assert material.get("alphaMode", "OPAQUE") == ("BLEND" if clear else "OPAQUE")
    _, data = compiled
    for node in file["nodes"]:
        if "camera" in node:
            camera = data.camera(node["name"])
            np.testing.assert_allclose(node["translation"], camera.xpos, atol=1e-5)
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, np.roll(node["rotation"], 1))
            np.testing.assert_allclose(turn, camera.xmat, atol=1e-5)
    assert [node["name"] for node in file["nodes"] if "camera" in node] == ["studio", "top"]


def test_other_shapes_are_refused():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
    )
    with pytest.raises(ValueError, match=r"`model` must have boxes, .*; got mjGEOM_PLANE"):
        model_glb(model, mujoco.MjData(model))
