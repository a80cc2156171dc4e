# SPDX-License-Identifier: Apache-2.0
"""Tests of spheres and linear swept spheres, built by the daemon on $BVHD_SOCKET and here."""
import unittest

import numpy as np

import bvhd
from test_client import CORNERS, FACES

SUCCESSIVE = bvhd.IndexingMode.SUCCESSIVE
POINTS = np.array([[0, 0, 0], [0, 1, 0], [1, 2, 0], [1, 3, 1]], np.float32)
RADII = np.array([0.4, 0.3, 0.2, 0.1], np.float32)


def distance_to_hull(origin, direction, ends, radii):
    """Where a ray from outside enters the hull of two spheres, found by trying spheres between."""
    way = np.linspace(0, 1, 4001)[:, None]
    centres = (1 - way) * ends[0].astype(float) + way * ends[1].astype(float)
    radius = (1 - way[:, 0]) * float(radii[0]) + way[:, 0] * float(radii[1])
    offset = centres - origin
    along = offset @ direction
    inside = radius**2 - np.sum(offset**2, axis=1) + along**2
    t = np.where(inside >= 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
    return t.min(), way[t.argmin(), 0]


class RoundTest(unittest.TestCase):
    def setUp(self):
        self.client = bvhd.Client(local=bvhd.Local.ALWAYS)
        self.addCleanup(self.client.close)

    def trace(self, geometry, *arguments, **options):
        scene = bvhd.cpu.Scene([self.client.build(geometry)])
        return scene.closest_hit(bvhd.cpu.rays(*arguments, **options))

    def test_spheres(self):
        spheres = bvhd.Spheres(POINTS, RADII)
        hits = self.trace(spheres, POINTS + [0, 0, 9], [0, 0, -1])
        np.testing.assert_allclose(hits["t"], 9 - RADII, rtol=1e-6)
        self.assertEqual(list(hits["primitive"]), [0, 1, 2, 3])
        kind = bvhd.HitFlags.SPHERE | bvhd.HitFlags.FRONT_FACE
        self.assertEqual(list(hits["flags"]), [kind] * 4)
        chosen = bvhd.Spheres(POINTS, 0.5, np.array([3, 1], np.uint16))
        hits = self.trace(chosen, POINTS + [0, 0, 9], [0, 0, -1])
        np.testing.assert_allclose(hits["t"], [np.inf, 8.5, np.inf, 8.5])
        self.assertEqual(list(hits["primitive"][1::2]), [1, 0])

    def test_forms_of_arrays(self):
        wanted = bytes(self.client.build(bvhd.Spheres(POINTS, RADII)))
        table = np.zeros((4, 6), np.float32)
        table[:, :3], table[:, 5] = POINTS, RADII
        backwards = np.ascontiguousarray(POINTS[::-1]), np.ascontiguousarray(RADII[::-1])
        for vertices, radii in (
            (table[:, :3], table[:, 5]),
            (POINTS.astype(float), RADII.astype(float)),
            (POINTS, list(RADII)),
            (backwards[0][::-1], backwards[1][::-1]),
            (np.hstack([POINTS, POINTS])[:, :4], RADII),
        ):
            self.assertEqual(bytes(self.client.build(bvhd.Spheres(vertices, radii))), wanted)
        half = np.array([0.5, 0.25, 0.125, 1], np.float16)
        self.assertEqual(
            bytes(self.client.build(bvhd.Spheres(POINTS.astype(np.float16), half))),
            bytes(self.client.build(bvhd.Spheres(POINTS, half.astype(np.float32)))),
        )
        self.assertEqual(
            bytes(self.client.build(bvhd.Spheres(POINTS, 0.5))),
            bytes(self.client.build(bvhd.Spheres(POINTS, np.full(4, 0.5)))),
        )
        empty = self.client.build(bvhd.Spheres(POINTS[:0], RADII[:0]))
        self.assertEqual(empty.statistics["primitives"], 0)

    def test_swept_spheres(self):
        strand = bvhd.SweptSpheres(POINTS, RADII, [0, 1, 2], mode=SUCCESSIVE)
        generator = np.random.default_rng(2)
        origins = generator.uniform([-0.5, -0.5, 5], [1.5, 3.5, 6], (300, 3))
        rays = bvhd.cpu.rays(origins, [0, 0, -1])
        hits = bvhd.cpu.Scene([self.client.build(strand)]).closest_hit(rays)
        self.assertGreater(int(np.isfinite(hits["t"]).sum()), 60)
        for ray, hit in zip(rays, hits):
            start, direction = ray["origin"].astype(float), ray["direction"].astype(float)
            parts = [
                distance_to_hull(start, direction, POINTS[i : i + 2], RADII[i : i + 2])
                for i in range(3)
            ]
            t = min(parts)[0]
            self.assertEqual(np.isfinite(hit["t"]), np.isfinite(t), ray)
            if np.isfinite(t):
                self.assertAlmostEqual(float(hit["t"]), t, delta=1e-4)
                self.assertAlmostEqual(float(hit["u"]), parts[hit["primitive"]][1], delta=2e-2)
                kind = bvhd.HitFlags.SWEPT_SPHERE | bvhd.HitFlags.FRONT_FACE
                self.assertEqual(hit["flags"], kind)

    def test_ways_to_name_ends(self):
        pairs = np.array([[0, 1], [1, 2], [2, 3]], np.uint16)
        rays = bvhd.cpu.rays(POINTS + np.array([0.1, 0, 9], np.float32), [0, 0, -1])
        gathered = self.client.build(bvhd.SweptSpheres(POINTS[pairs].reshape(-1, 3), 0.25))
        wanted = bvhd.cpu.Scene([gathered]).closest_hit(rays)
        self.assertTrue(np.isfinite(wanted["t"]).all())
        for indices in (pairs, pairs.reshape(-1), pairs.tolist()):
            listed = self.client.build(bvhd.SweptSpheres(POINTS, 0.25, indices))
            self.assertEqual(listed.statistics["primitives"], 3)
            np.testing.assert_array_equal(bvhd.cpu.Scene([listed]).closest_hit(rays), wanted)
        axis = ([0, -5, 0], [0, 1, 0])
        for caps, distance in ((bvhd.EndCaps.CHAINED, 4.6), (bvhd.EndCaps.NONE, np.inf)):
            alone = bvhd.SweptSpheres(POINTS[:2], RADII[:2], caps=caps)
            self.assertAlmostEqual(float(self.trace(alone, *axis)["t"][0]), distance, places=5)

    def test_one_scene_of_all_kinds(self):
        square = bvhd.Triangles(CORNERS, FACES)
        ball = bvhd.Spheres(np.zeros((1, 3), np.float32), 0.5)
        part = bvhd.SweptSpheres(np.array([[0, 0, 0], [1, 0, 0]], np.float32), 0.25)
        box = bvhd.Aabbs([[0, 0, 0, 1, 1, 1]])
        bottoms = self.client.build([square, ball, part, box])
        transforms = np.tile(np.eye(3, 4), (4, 1, 1))
        transforms[:, 0, 3] = [0, 10, 20, 30]
        top = self.client.build(bvhd.TopLevel(bottoms, transforms=transforms))
        scene = bvhd.cpu.Scene([*bottoms, top])
        origins = np.array([[0.25, 0.25, 9], [10, 0, 9], [20.5, 0, 9], [30.5, 0.5, 9]])
        flags = scene.closest_hit(bvhd.cpu.rays(origins, [0, 0, -1]))["flags"]
        kinds = bvhd.HitFlags
        self.assertEqual(
            list(flags & (kinds.AABB | kinds.SPHERE | kinds.SWEPT_SPHERE)),
            [0, kinds.SPHERE, kinds.SWEPT_SPHERE, kinds.AABB],
        )
        skipping = bvhd.cpu.rays(origins, [0, 0, -1], flags=bvhd.RayFlags.SKIP_TRIANGLES)
        self.assertEqual(list(scene.any_hit(skipping)), [False, False, False, True])

    def test_the_same_bytes_from_a_daemon(self):
        requests = [
            bvhd.Spheres(POINTS, RADII),
            bvhd.Spheres(POINTS, 0.5, [3, 3, 0]),
            bvhd.SweptSpheres(POINTS, RADII, [0, 1, 2], mode=SUCCESSIVE),
            bvhd.SweptSpheres(POINTS, RADII, caps=bvhd.EndCaps.NONE),
        ]
        results = []
        for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
            with bvhd.Client(local=local, connect_timeout=30) as client:
                bottoms = [bvhd.BottomLevel([request]) for request in requests]
                built = client.build([*bottoms, bvhd.TopLevel(bottoms)])
                results.append([(bytes(one), one.key) for one in built])
        self.assertEqual(results[0], results[1])

    def test_updates(self):
        flags = bvhd.BuildFlags.ALLOW_UPDATE
        for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
            with bvhd.Client(local=local, connect_timeout=30) as client:
                for make in (
                    lambda scale: bvhd.Spheres(POINTS * np.float32(scale), RADII * scale),
                    lambda scale: bvhd.SweptSpheres(POINTS * np.float32(scale), RADII * scale),
                ):
                    first = client.build(bvhd.BottomLevel([make(1)], flags=flags))
                    moved = client.build(bvhd.BottomLevel([make(2)], flags=flags, source=first))
                    self.assertEqual(moved.statistics["refits"], 1)
                    hit = bvhd.cpu.Scene([moved]).closest_hit(bvhd.cpu.rays([0, 0, 9], [0, 0, -1]))
                    self.assertAlmostEqual(float(hit["t"][0]), 8.2, places=5)

    def test_what_is_refused_here(self):
        for make, text in (
            (lambda: bvhd.Spheres(POINTS, RADII[:3]), "radii"),
            (lambda: bvhd.Spheres(POINTS, RADII.reshape(2, 2)), "radii"),
            (lambda: bvhd.Spheres(POINTS, ["a"] * 4), "radii"),
            (lambda: bvhd.Spheres(POINTS[:, :1], RADII), "vertices"),
            (lambda: bvhd.Spheres(POINTS, RADII, [4]), "vertex 4"),
            (lambda: bvhd.Spheres(POINTS, RADII, [-1]), "indices"),
            (lambda: bvhd.Spheres(POINTS, RADII, [[0, 1]]), "indices"),
            (lambda: bvhd.Spheres(POINTS, RADII, [0.5]), "indices"),
            (lambda: bvhd.SweptSpheres(POINTS[:3], RADII[:3]), "multiple of 2"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, [0, 1, 2]), "indices"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, [[0, 4]]), "vertex 4"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, [3], mode=SUCCESSIVE), "vertex 4"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, mode=SUCCESSIVE), "SUCCESSIVE"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, mode=2), "IndexingMode"),
            (lambda: bvhd.SweptSpheres(POINTS, RADII, caps=2), "EndCaps"),
        ):
            with self.assertRaisesRegex(ValueError, text):
                self.client.build(make())

    def test_what_the_library_refuses(self):
        cases = (
            (bvhd.Spheres(POINTS, [1, 1, -1, 1]), "spheres[2].radius", "10436"),
            (bvhd.SweptSpheres(POINTS, -1), "linearSweptSpheres[", "10426"),
        )
        for geometry, place, rule in cases:
            texts = set()
            for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
                with bvhd.Client(local=local, connect_timeout=30) as client:
                    with self.assertRaises(bvhd.Error) as raised:
                        client.build(geometry)
                self.assertEqual(raised.exception.status, bvhd.Status.INVALID)
                self.assertIn("infos[0].geometries[0]." + place, raised.exception.where)
                self.assertIn(rule, raised.exception.vuid)
                texts.add(str(raised.exception))
            self.assertEqual(len(texts), 1, texts)
        mixed = bvhd.BottomLevel([bvhd.Spheres(POINTS, RADII), bvhd.Triangles(CORNERS, FACES)])
        with self.assertRaises(bvhd.Error):
            self.client.build(mixed)


if __name__ == "__main__":
    unittest.main()
