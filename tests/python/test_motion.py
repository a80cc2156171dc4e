# SPDX-License-Identifier: Apache-2.0
"""Tests of triangles and instances that move, by their structs and by rays at several times."""
import ctypes as c
import unittest

import numpy as np

import bvhd
from bvhd import _structs as s
from test_client import CORNERS, FACES

SHIFT = np.array([1, 2, 3], np.float32)
SRT = dict.fromkeys(
    "sx a b pvx sy c pvy sz pvz qx qy qz qw tx ty tz".split(),
    0.0,
)


def srt(**numbers):
    """The 16 numbers of a VkSRTDataNV: those of the identity, and what is given instead."""
    return list({**SRT, "sx": 1, "sy": 1, "sz": 1, "qw": 1, **numbers}.values())


def fill(geometry):
    """Returns Vulkan's struct of a geometry, and what keeps its memory."""
    struct, extent = s.Geometry(), s.Range()
    return struct, extent, geometry._fill(struct, extent)


def floats(address, stride, count):
    """Reads the first three floats of rows."""
    rows = [(c.c_float * 3).from_address(address + stride * i) for i in range(count)]
    return np.array([list(row) for row in rows])


class DescriptionTest(unittest.TestCase):
    def end_of(self, geometry):
        """Checks the struct of motion triangles; returns the vertices at both times."""
        struct, extent, kept = fill(geometry)
        data = struct.geometry.triangles
        end = s.MotionTrianglesData.from_address(data.pNext)
        self.assertEqual((end.sType, end.pNext), (1000327000, None))
        count = data.maxVertex + 1
        arrays = [floats(at, data.vertexStride, count) for at in (data.vertexData, end.vertexData)]
        self.assertTrue(kept)
        return (extent.primitiveCount, *arrays)

    def test_vertices_of_both_times(self):
        table = np.zeros((len(CORNERS), 7), np.float32)
        table[:, :3], table[:, 4:] = CORNERS, CORNERS + SHIFT
        for start, end in (
            (CORNERS, CORNERS + SHIFT),
            (table[:, :3], table[:, 4:]),
            (CORNERS, table[:, 4:]),  # with rows that are not equally far apart
            (np.asfortranarray(CORNERS), CORNERS + SHIFT),
        ):
            count, first, last = self.end_of(bvhd.Triangles(start, FACES, end_vertices=end))
            self.assertEqual(count, len(FACES))
            np.testing.assert_array_equal(first, CORNERS)
            np.testing.assert_array_equal(last, CORNERS + SHIFT)
        none = CORNERS[:0]
        self.assertEqual(self.end_of(bvhd.Triangles(none, end_vertices=none))[0], 0)
        self.assertIsNone(fill(bvhd.Triangles(CORNERS, FACES))[0].geometry.triangles.pNext)

    def test_wrong_vertices(self):
        for end in (CORNERS[1:], CORNERS.astype(float), CORNERS[:, :2], 4):
            with self.assertRaisesRegex(ValueError, "end_vertices"):
                fill(bvhd.Triangles(CORNERS, FACES, end_vertices=end))

    def test_flags(self):
        still, moving = bvhd.Triangles(CORNERS), bvhd.Triangles(CORNERS, end_vertices=CORNERS)
        motion, update = bvhd.BuildFlags.MOTION, bvhd.BuildFlags.ALLOW_UPDATE
        self.assertEqual(bvhd.BottomLevel([still], update).flags, update)
        self.assertEqual(bvhd.BottomLevel([still, moving], update).flags, update | motion)
        top = bvhd.TopLevel([bvhd.BottomLevel([still])], flags=update)
        self.assertEqual((top.flags, top.records.dtype), (update, s.INSTANCE))
        top = bvhd.TopLevel([bvhd.BottomLevel([still])], end_transforms=np.eye(3, 4), flags=update)
        self.assertEqual(top.flags, update | motion)

    def test_records(self):
        """Records have 160 bytes; what all types have in common is behind the numbers of each."""
        structures = [bvhd.BottomLevel([bvhd.Triangles(CORNERS)]) for _ in range(2)]
        start = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
        still = bvhd.TopLevel(structures, transforms=start, flags=bvhd.BuildFlags.MOTION)
        matrix = bvhd.TopLevel(structures, transforms=start, end_transforms=-start, masks=5)
        turning = bvhd.TopLevel(structures, transforms=srt(), end_transforms=[srt(qz=1), srt(tx=2)])
        for kind, (top, end) in enumerate(((still, 56), (matrix, 104), (turning, 136))):
            words = top.records.view(np.uint32).reshape(2, 40)
            at = end // 4
            self.assertEqual(words[:, :2].tolist(), [[kind, 0]] * 2)
            self.assertEqual(words[:, at].tolist(), [0xFF000000 if kind != 1 else 5 << 24] * 2)
            handles = [structure.handle for structure in structures]
            self.assertEqual(words[:, at + 2].tolist(), handles)
            self.assertFalse(words[:, at + 4 :].any())
        np.testing.assert_array_equal(matrix.records["end_transform"], -start)
        self.assertEqual(turning.records["transform"].tolist(), [srt(), srt()])
        self.assertEqual(turning.records["end_transform"].tolist(), [srt(qz=1), srt(tx=2)])

    def test_wrong_records(self):
        one = [bvhd.BottomLevel([bvhd.Triangles(CORNERS)])]
        for start, end in ((np.eye(3, 4), srt()), (srt(), np.eye(3, 4)), (srt(), None)):
            with self.assertRaisesRegex(ValueError, "transforms"):
                bvhd.TopLevel(one, transforms=start, end_transforms=end)
        with self.assertRaises(ValueError):
            bvhd.TopLevel(one, transforms=np.eye(4), end_transforms=np.eye(4))


class MotionTest(unittest.TestCase):
    def setUp(self):
        self.client = bvhd.Client(local=bvhd.Local.ALWAYS)
        self.addCleanup(self.client.close)

    def distances(self, structures, points, times):
        """How far rays from z = 9 go at these times: downwards through the points (x, y)."""
        origins = np.column_stack([np.atleast_2d(points), np.full(len(np.atleast_2d(points)), 9)])
        rays = bvhd.cpu.rays(origins, [0, 0, -1], times=times)
        return bvhd.cpu.Scene(structures).closest_hit(rays)["t"]

    def test_triangles(self):
        flat = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32)
        up = np.array([0, 0, 4], np.float32)
        rising = self.client.build(bvhd.Triangles(flat, end_vertices=flat + up))
        times = np.array([0, 0.25, 0.5, 1], np.float32)
        np.testing.assert_allclose(
            self.distances([rising], np.zeros((4, 2)), times), 9 - 4 * times, rtol=1e-6
        )
        still = bvhd.Triangles(flat + np.array([5, 0, 0], np.float32))
        passing = bvhd.Triangles(flat, end_vertices=flat + np.array([10, 0, 0], np.float32))
        both = self.client.build(bvhd.BottomLevel([still, passing]))
        hits = self.distances([both], [[0, 0], [0, 0], [5, 0], [5, 0], [10, 0]], [0, 1, 0, 0.5, 1])
        self.assertEqual(np.isfinite(hits).tolist(), [True, False, True, True, True])

    def test_instances(self):
        flat = np.array([[0, -1, 0], [4, -1, 0], [4, 1, 0], [0, 1, 0]], np.float32)
        faces = [[0, 1, 2], [0, 2, 3]]
        bar = self.client.build(bvhd.Triangles(flat, faces))
        end = np.eye(3, 4)
        end[2, 3] = 4
        rising = self.client.build(bvhd.TopLevel([bar], end_transforms=end))
        times = np.array([0, 0.25, 0.5, 1], np.float32)
        points = np.full((4, 2), 0.5)
        np.testing.assert_allclose(
            self.distances([bar, rising], points, times), 9 - 4 * times, rtol=1e-6
        )
        half = np.sqrt(0.5)
        turned = self.client.build(
            bvhd.TopLevel([bar], transforms=srt(), end_transforms=srt(qz=1, qw=0))
        )
        turns = ((3, 0, 0), (3, 0, 1), (-3, 0, 1), (0, 3, 0.5), (3 * half, 3 * half, 0.5))
        hits = self.distances([bar, turned], [turn[:2] for turn in turns], [t for *_, t in turns])
        self.assertEqual(np.isfinite(hits).tolist(), [True, False, True, True, False])

    def test_levels(self):
        """A top level whose instances stand still, over a structure that moves."""
        flat = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32)
        rising = bvhd.Triangles(flat, end_vertices=flat + np.array([0, 0, 4], np.float32))
        below = bvhd.BottomLevel([rising])
        top = bvhd.TopLevel([below], flags=bvhd.BuildFlags.MOTION)
        results = self.client.build([below, top])
        np.testing.assert_allclose(
            self.distances(results, np.zeros((2, 2)), [0.5, 1]), [7, 5], rtol=1e-6
        )

    def test_a_top_level_over_what_moves_moves(self):
        """Whether the bottom level is a result, a reference, or of the same batch."""
        below = bvhd.BottomLevel([bvhd.Triangles(CORNERS, FACES, end_vertices=CORNERS)])
        built = self.client.build(below)
        still = self.client.build(bvhd.Triangles(CORNERS, FACES))
        self.assertEqual((built.moves, still.moves), (True, False))
        known = bvhd.Reference(built.key, built.bounds, moves=True)
        for one in (built, known):
            with self.assertRaisesRegex(bvhd.Error, "MOTION_BIT_NV") as raised:
                self.client.build(bvhd.TopLevel([still, one]))
            self.assertEqual(raised.exception.status, bvhd.Status.INVALID)
            self.assertTrue(
                raised.exception.where.endswith("instances[1].accelerationStructureReference")
            )
            top = self.client.build(bvhd.TopLevel([still, one], flags=bvhd.BuildFlags.MOTION))
            self.assertTrue(top.moves)
        with self.assertRaisesRegex(bvhd.Error, "MOTION_BIT_NV"):
            self.client.build([below, bvhd.TopLevel([below])])
        self.assertFalse(self.client.build(bvhd.TopLevel([still])).moves)

    def test_updates(self):
        """Both ends of a motion change, and the type of a motion instance."""
        flags = bvhd.BuildFlags.ALLOW_UPDATE
        flat = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32)
        end, up = np.eye(3, 4), np.array([0, 0, 1], np.float32)
        end[2, 3] = 1
        blobs = []
        for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
            with bvhd.Client(local=local, connect_timeout=30) as client:
                last = [None, None]
                for step in range(3):
                    rising = bvhd.Triangles(flat + step * up, end_vertices=flat + 3 * step * up)
                    mesh = bvhd.BottomLevel([rising], flags=flags, source=last[0])
                    motion = {"transforms": srt(), "end_transforms": srt(tz=1)}
                    if step == 1:
                        motion = {"end_transforms": end}
                    top = bvhd.TopLevel([mesh], flags=flags, source=last[1], **motion)
                    last = client.build([mesh, top])
                    if step > 0:
                        self.assertEqual([one.statistics["refits"] for one in last], [step, step])
                    heights = [step, 2 * step + 0.5, 3 * step + 1]
                    hits = self.distances(last, np.zeros((3, 2)), [0, 0.5, 1])
                    np.testing.assert_allclose(hits, 9 - np.array(heights), rtol=1e-6)
                    blobs.append([bytes(one) for one in last])
        self.assertEqual(blobs[:3], blobs[3:])

    def test_positions(self):
        end = CORNERS + np.array([0, 2, 4], np.float32)
        flags = bvhd.BuildFlags.ALLOW_DATA_ACCESS
        moving = bvhd.Triangles(CORNERS, FACES, end_vertices=end)
        scene = bvhd.cpu.Scene([self.client.build(bvhd.BottomLevel([moving], flags))])
        for time in (0, 0.5, 1):
            np.testing.assert_array_equal(
                scene.positions([0], time=time)[0],
                (CORNERS + np.array([0, 2, 4]) * time)[FACES[0]],
            )
        with self.assertRaisesRegex(bvhd.Error, "move"):
            scene.positions([0])

    def test_what_the_library_refuses(self):
        bottom = bvhd.BottomLevel([bvhd.Triangles(CORNERS, FACES, end_vertices=CORNERS)])
        object.__setattr__(bottom, "flags", bvhd.BuildFlags.NONE)
        with self.assertRaises(bvhd.Error) as raised:
            self.client.build(bottom)
        self.assertEqual(raised.exception.status, bvhd.Status.INVALID)
        self.assertEqual(
            raised.exception.vuid, "VUID-VkAccelerationStructureCreateInfoKHR-flags-04955"
        )


if __name__ == "__main__":
    unittest.main()
