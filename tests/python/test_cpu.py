# SPDX-License-Identifier: Apache-2.0
"""Tests of rays on the CPU, and of containers: $BVHD_CONTAINER names one with instances."""
import gc
import os
import tempfile
import unittest

import numpy as np

import bvhd
from test_client import CORNERS, FACES, waves


class CpuTest(unittest.TestCase):
    def setUp(self):
        self.client = bvhd.Client(local=bvhd.Local.ALWAYS)
        self.addCleanup(self.client.close)

    def test_triangles(self):
        square = self.client.build(bvhd.Triangles(CORNERS, FACES))
        scene = bvhd.cpu.Scene([square])
        self.assertEqual(list(scene.bounds), [0, 0, 0, 1, 1, 0])
        rays = bvhd.cpu.rays([[0.25, 0.25, 3], [0.9, 0.9, 3], [2, 2, 3]], [0, 0, -2])
        hits = scene.closest_hit(rays)
        self.assertEqual(list(hits["t"]), [1.5, 1.5, np.inf])
        self.assertEqual(list(hits["primitive"]), [0, 1, 0])
        self.assertEqual(list(hits["instance"]), [bvhd.cpu.NO_INSTANCE] * 3)
        self.assertEqual([hits["u"][0], hits["v"][0]], [0.25, 0.25])
        self.assertTrue(hits["flags"][0] & bvhd.HitFlags.FRONT_FACE)
        self.assertEqual(list(scene.any_hit(rays)), [True, True, False])
        rays["tmax"] = 1
        self.assertEqual(list(scene.any_hit(rays)), [False] * 3)
        self.assertEqual(len(scene.closest_hit(rays[:0])), 0)
        self.assertEqual(len(scene.closest_hit(rays[::2])), 2)

    def test_against_a_plane(self):
        mesh = waves(30)
        flat = bvhd.Triangles(np.asarray(mesh.vertices) * [1, 1, 0], mesh.indices)
        scene = bvhd.cpu.Scene([self.client.build(flat)])
        generator = np.random.default_rng(1)
        origins = generator.uniform([1, 1, 1], [29, 29, 9], (5000, 3)).astype(np.float32)
        directions = generator.uniform([-0.1, -0.1, -1], [0.1, 0.1, -0.9], (5000, 3))
        rays = bvhd.cpu.rays(origins, directions)
        wanted = -rays["origin"][:, 2].astype(float) / rays["direction"][:, 2]
        inside = rays["origin"][:, :2] + wanted[:, None] * rays["direction"][:, :2]
        reached = np.all((inside > 0.001) & (inside < 29.999), axis=1)
        t = scene.closest_hit(rays)["t"]
        self.assertGreater(int(reached.sum()), 4000)
        np.testing.assert_allclose(t[reached], wanted[reached], rtol=1e-5)

    def test_instances_and_bytes(self):
        square = self.client.build(bvhd.Triangles(CORNERS, FACES))
        transforms = np.tile(np.eye(3, 4), (2, 1, 1))
        transforms[1, 2, 3] = 5
        top = self.client.build(
            bvhd.TopLevel(
                [square], [0, 0], transforms=transforms, custom_indices=[7, 8], masks=[1, 2]
            )
        )
        rays = bvhd.cpu.rays([0.5, 0.25, 9], [0, 0, -1], masks=0xFF)
        for rows in (
            [square, top],
            [bytes(square), bytes(top)],
            [memoryview(b"x" + bytes(square))[1:], bytearray(bytes(top))],
        ):
            scene = bvhd.cpu.Scene(rows)
            del rows
            gc.collect()
            hit = scene.closest_hit(rays)[0]
            self.assertEqual((hit["t"], hit["instance"], hit["custom_index"]), (4, 1, 8))
            self.assertEqual(
                scene.closest_hit(bvhd.cpu.rays([0.5, 0.25, 9], [0, 0, -1], masks=1))["t"][0], 9
            )

    def test_positions(self):
        flags = bvhd.BuildFlags.ALLOW_DATA_ACCESS
        mesh = waves(20)
        bottom = self.client.build(bvhd.BottomLevel([mesh], flags=flags))
        scene = bvhd.cpu.Scene([bottom])
        corners = np.asarray(mesh.vertices, np.float32)[np.asarray(mesh.indices)]
        np.testing.assert_array_equal(scene.positions(np.arange(len(corners))), corners)
        np.testing.assert_array_equal(scene.positions(7)[0], corners[7])
        self.assertEqual(scene.positions([]).shape, (0, 3, 3))
        for wrong in (1.5, [[0, 1]], -1, [2**32]):
            with self.assertRaisesRegex(ValueError, "primitives"):
                scene.positions(wrong)
        for arguments in ({"geometry": 1}, {"structure": 1}):
            with self.assertRaises(bvhd.Error):
                scene.positions(0, **arguments)
        without = bvhd.cpu.Scene([self.client.build(mesh)])
        with self.assertRaisesRegex(bvhd.Error, "ALLOW_DATA_ACCESS"):
            without.positions(0)

    def test_errors(self):
        square = self.client.build(bvhd.Triangles(CORNERS, FACES))
        with self.assertRaises(bvhd.Error) as raised:
            bvhd.cpu.Scene([bytes(square)[:-64]])
        self.assertEqual(raised.exception.status, bvhd.Status.CORRUPT)
        self.assertTrue(raised.exception.where.startswith("blobs[0]"), raised.exception.where)
        scene = bvhd.cpu.Scene([square])
        with self.assertRaises(bvhd.Error) as raised:
            scene.closest_hit(bvhd.cpu.rays(np.zeros((3, 3)), [0, 0, 1], times=[0, 2, 0]))
        self.assertEqual(raised.exception.where, "rays[1].time")
        for wrong in (np.zeros(3), np.zeros((2, 2), bvhd.cpu.RAY)):
            with self.assertRaises(ValueError):
                scene.closest_hit(wrong)
        with self.assertRaises(ValueError):
            bvhd.cpu.rays([[0, 0]], [[0, 0]])
        scene.close()
        with self.assertRaises(ValueError):
            scene.closest_hit(bvhd.cpu.rays([0, 0, 0], [0, 0, 1]))


class ContainerTest(unittest.TestCase):
    def test_a_file_of_bvhctl(self):
        path = os.environ["BVHD_CONTAINER"]
        container = bvhd.Container(path)
        self.assertEqual(len(container.tops), 1)
        self.assertIn("schema", container.manifest)
        rows = container.rows()
        self.assertTrue(rows[-1].is_top_level)
        self.assertFalse(rows[0].is_top_level)
        self.assertTrue(rows[0].data.readonly)
        self.assertEqual(rows[0].target, bvhd.Target.PORTABLE)
        self.assertEqual(len(rows[0].key), 32)
        self.assertTrue(rows[-1].file.endswith(".as"))
        for index in range(len(container.structures)):
            container.check(index)
        del container
        gc.collect()
        with bvhd.Client(local=bvhd.Local.ALWAYS) as client:
            top = client.build(bvhd.TopLevel(rows[:1], [0, 0]))
        self.assertEqual(top.statistics["instances"], 2)
        scene = bvhd.cpu.Scene(rows)
        low, high = np.split(scene.bounds, 2)
        np.testing.assert_allclose(scene.bounds, rows[-1].bounds, rtol=1e-4, atol=1e-4)
        down = bvhd.cpu.rays([*((low + high) / 2)[:2], high[2] + 1], [0, 0, -1])
        self.assertEqual(scene.any_hit(down).shape, (1,))

    def test_damage(self):
        with open(os.environ["BVHD_CONTAINER"], "rb") as file:
            data = bytearray(file.read())
        structure = bvhd.Container(os.environ["BVHD_CONTAINER"]).structures[0]
        data[data.index(bytes(structure.array)) + 60] ^= 1
        with tempfile.NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            with self.assertRaises(bvhd.Error) as raised:
                bvhd.Container(file.name)
            self.assertEqual(raised.exception.status, bvhd.Status.CORRUPT)
            lazy = bvhd.Container(file.name, is_lazy=True)
            with self.assertRaises(bvhd.Error):
                lazy.check(0)
        with self.assertRaises(bvhd.Error) as raised:
            bvhd.Container(os.path.join(os.path.dirname(file.name), "no", "file"))
        self.assertEqual(raised.exception.status, bvhd.Status.NOT_FOUND)


if __name__ == "__main__":
    unittest.main()
