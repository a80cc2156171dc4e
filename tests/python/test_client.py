# SPDX-License-Identifier: Apache-2.0
"""Tests of the package with the daemon on $BVHD_SOCKET."""
import gc
import os
import select
import signal
import tempfile
import threading
import time
import unittest

import numpy as np

import bvhd

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [1, 3, 2]], np.uint32)


def waves(side: int) -> bvhd.Triangles:
    """A surface of 2 * side * side triangles."""
    x, y = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    z = np.sin(x * 0.3) * np.cos(y * 0.2)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    corner = (y * (side + 1) + x)[:-1, :-1].reshape(-1, 1)
    near = corner + [0, 1, side + 1]
    far = corner + [1, side + 2, side + 1]
    return bvhd.Triangles(vertices, np.concatenate([near, far]))


class ClientTest(unittest.TestCase):
    def setUp(self):
        self.client = bvhd.Client(connect_timeout=30)
        self.addCleanup(self.client.close)

    def build(self, what, **options):
        return self.client.build(what, **options)

    def test_one_geometry(self):
        result = self.build(bvhd.Triangles(CORNERS, FACES))
        self.assertEqual(result.statistics["triangles"], 2)
        self.assertEqual(list(result.bounds), [0, 0, 0, 1, 1, 0])
        self.assertEqual(len(result.slabs), 20)
        self.assertEqual(result.target, bvhd.Target.PORTABLE)
        self.assertIn(result.quality, (bvhd.Quality.FAST, bvhd.Quality.BALANCED, bvhd.Quality.HIGH))
        self.assertIn(result.key.hex()[:16], repr(result))
        self.assertEqual(len(result.key), 32)

    def test_bytes_are_not_copied(self):
        result = self.build(bvhd.Triangles(CORNERS, FACES))
        address = result.array.__array_interface__["data"][0]
        view = np.frombuffer(result.data, np.uint8)
        self.assertEqual(view.__array_interface__["data"][0], address)
        self.assertEqual(address % 64, 0)
        self.assertTrue(result.data.readonly)
        self.assertFalse(result.array.flags.writeable)
        self.assertEqual(bytes(result), view.tobytes())
        self.assertEqual(len(result), result.size)

    def test_equal_geometry_gives_equal_bytes(self):
        wanted = bytes(self.build(bvhd.Triangles(CORNERS, FACES)))
        interleaved = np.zeros(4, [("position", "f4", 3), ("normal", "f4", 3)])
        interleaved["position"] = CORNERS
        reverse = np.ascontiguousarray(CORNERS[::-1])[::-1]
        readonly = CORNERS.copy()
        readonly.setflags(write=False)
        for vertices in (
            interleaved["position"],
            reverse,
            readonly,
            np.asfortranarray(CORNERS),
            CORNERS.astype(np.float64),
            CORNERS.astype(np.float16),
            CORNERS[:, :2].copy(),
            np.hstack([CORNERS, CORNERS]).astype(np.float32)[:, :4],
            CORNERS.astype(">f4"),
        ):
            self.assertEqual(bytes(self.build(bvhd.Triangles(vertices, FACES))), wanted)
        for indices in (
            FACES.reshape(-1),
            FACES.astype(np.uint8),
            FACES.astype(np.uint16),
            FACES.astype(np.int64),
            FACES[:, ::-1][:, ::-1],
            FACES.tolist(),
        ):
            self.assertEqual(bytes(self.build(bvhd.Triangles(CORNERS, indices))), wanted)
        moved = bvhd.Triangles(
            CORNERS * 2 + 1, FACES, transform=[[0.5, 0, 0, -0.5], [0, 0.5, 0, -0.5], [0, 0, 1, -1]]
        )
        self.assertEqual(bytes(self.build(moved)), wanted)
        alone = self.build(bvhd.Triangles(CORNERS[FACES].reshape(-1, 3)))
        self.assertEqual(alone.statistics["triangles"], 2)

    def test_packed_formats(self):
        bytes_ = np.array([[0, 0, 0, 9], [127, 0, 0, 9], [0, 127, 0, 9]], np.int8)
        packed = bvhd.Triangles(bytes_, vertex_format=bvhd.VertexFormat.R8G8B8A8_SNORM)
        wanted = bvhd.Triangles(CORNERS[:3])
        self.assertEqual(bytes(self.build(packed)), bytes(self.build(wanted)))
        words = np.array([[0], [1023], [1023 << 10]], np.uint32)
        packed = bvhd.Triangles(words, vertex_format=bvhd.VertexFormat.A2B10G10R10_UNORM_PACK32)
        self.assertEqual(bytes(self.build(packed)), bytes(self.build(wanted)))

    def test_empty(self):
        nothing = np.zeros((0, 3), np.float32)
        for empty in (
            bvhd.Triangles(nothing),
            bvhd.Triangles(nothing, []),
            bvhd.Aabbs(np.zeros((0, 6))),
        ):
            self.assertEqual(self.build(empty).statistics["primitives"], 0)
        self.assertEqual(self.build(bvhd.BottomLevel([])).statistics["primitives"], 0)
        self.assertEqual(self.build(bvhd.TopLevel([])).statistics["instances"], 0)
        self.assertEqual(self.build([]), [])

    def test_boxes(self):
        result = self.build(bvhd.Aabbs([[0, 0, 0, 1, 1, 1], [2, 2, 2, 3, 3, 4]]))
        self.assertEqual(list(result.bounds), [0, 0, 0, 3, 3, 4])
        strided = np.zeros((2, 7), np.float32)
        strided[:, :6] = [[0, 0, 0, 1, 1, 1], [2, 2, 2, 3, 3, 4]]
        self.assertEqual(bytes(self.build(bvhd.Aabbs(strided[:, :6]))), bytes(result))

    def test_instances(self):
        bottoms = self.build([bvhd.Triangles(CORNERS, FACES), bvhd.Aabbs([[0, 0, 0, 1, 1, 1]])])
        transforms = np.tile(np.eye(3, 4, dtype=np.float32), (3, 1, 1))
        transforms[:, 0, 3] = [0, 10, 20]
        top = bvhd.TopLevel(
            bottoms,
            [0, 1, 0],
            transforms=transforms,
            custom_indices=[5, 6, 7],
            masks=0x0F,
            record_offsets=3,
            instance_flags=bvhd.InstanceFlags.FORCE_OPAQUE,
        )
        self.assertEqual(list(top.records["index_and_mask"]), [0x0F000005, 0x0F000006, 0x0F000007])
        self.assertEqual(list(top.records["offset_and_flags"]), [0x04000003] * 3)
        result = self.build(top)
        self.assertEqual(result.statistics["instances"], 3)
        self.assertAlmostEqual(float(result.bounds[3]), 21, places=4)
        kept = [bvhd.Reference(bottom.key, bottom.bounds, bottom.slabs) for bottom in bottoms]
        again = bvhd.TopLevel(
            kept,
            [0, 1, 0],
            transforms=transforms,
            custom_indices=[5, 6, 7],
            masks=0x0F,
            record_offsets=3,
            instance_flags=bvhd.InstanceFlags.FORCE_OPAQUE,
        )
        self.assertEqual(bytes(self.build(again)), bytes(result))

    def test_references_by_key_and_to_the_same_batch(self):
        bottom = self.build(bvhd.Triangles(CORNERS, FACES))
        wanted = bytes(self.build(bvhd.TopLevel([bottom, bottom])))
        by_key = bvhd.Reference(bottom.key)
        self.assertEqual(bytes(self.build(bvhd.TopLevel([by_key, by_key]))), wanted)
        below = bvhd.BottomLevel([bvhd.Triangles(CORNERS, FACES)])
        both = self.build([bvhd.TopLevel([below, below]), below])
        self.assertEqual([bytes(result) for result in both], [wanted, bytes(bottom)])
        with self.assertRaises(ValueError):
            self.build(bvhd.TopLevel([below]))
        with self.assertRaises(bvhd.Error) as raised:
            self.build(bvhd.TopLevel([bvhd.Reference(bytes(32))]))
        self.assertEqual(raised.exception.status, bvhd.Status.NOT_FOUND)

    def test_options(self):
        mesh = waves(12)
        keys = set()
        for quality in (bvhd.Quality.FAST, bvhd.Quality.BALANCED, bvhd.Quality.HIGH):
            result = self.build(mesh, quality=quality)
            self.assertEqual(result.quality, quality)
            keys.add(result.key)
        keys.add(self.build(mesh, layout_flags=bvhd.LayoutFlags.FAST_TRIANGLES).key)
        keys.add(
            self.build(
                bvhd.Triangles(mesh.vertices, mesh.indices, flags=bvhd.GeometryFlags.OPAQUE)
            ).key
        )
        keys.add(self.build(bvhd.BottomLevel([mesh], flags=bvhd.BuildFlags.PREFER_FAST_TRACE)).key)
        self.assertEqual(len(keys), 6)
        auto = self.build(
            mesh, quality=bvhd.Quality.AUTO, rays_per_primitive=1e6, priority=bvhd.Priority.HIGH
        )
        self.assertIn(auto.quality, (bvhd.Quality.BALANCED, bvhd.Quality.HIGH))

    def test_errors_name_the_rule_and_the_place(self):
        with self.assertRaises(bvhd.Error) as raised:
            self.build([bvhd.Triangles(CORNERS, FACES), bvhd.Triangles(CORNERS, [[0, 1, 4]])])
        error = raised.exception
        self.assertEqual(error.status, bvhd.Status.INVALID)
        self.assertIn("maxVertex", error.vuid)
        self.assertTrue(
            error.where.startswith("infos[1].geometries[0].triangles.indices[2]"), error.where
        )
        self.assertIn("4", error.text)
        for part in ("INVALID", error.where, error.text, error.vuid):
            self.assertIn(part, str(error))
        with self.client.submit(
            [bvhd.Triangles(CORNERS, FACES), bvhd.Triangles(CORNERS, [[0, 1, 4]])]
        ) as batch:
            self.assertTrue(batch.wait())
            self.assertIsNone(batch.error(0))
            self.assertEqual(batch.error(1).where, error.where)
            self.assertEqual(batch.result(0).statistics["triangles"], 2)
            with self.assertRaises(IndexError):
                batch.result(2)

    def test_arrays_that_are_wrong(self):
        for make in (
            lambda: bvhd.Triangles(np.zeros((3, 5), np.float32)),
            lambda: bvhd.Triangles(np.zeros((3, 3), np.int32)),
            lambda: bvhd.Triangles(np.zeros(9, np.float32)),
            lambda: bvhd.Triangles(CORNERS),
            lambda: bvhd.Triangles(CORNERS, [[0, 1]]),
            lambda: bvhd.Triangles(CORNERS, [[0.0, 1.0, 2.0]]),
            lambda: bvhd.Triangles(CORNERS, [[0, -1, 2]]),
            lambda: bvhd.Triangles(CORNERS[:0], [[0, 1, 2]]),
            lambda: bvhd.Triangles(CORNERS[:3], transform=np.eye(4)),
            lambda: bvhd.Triangles(
                np.zeros((3, 2), np.float32), vertex_format=bvhd.VertexFormat.R32G32B32_SFLOAT
            ),
            lambda: bvhd.Aabbs(np.zeros((2, 3))),
        ):
            with self.assertRaises(ValueError):
                self.build(make())
        for arguments in (
            {"which": [1]},
            {"which": [-1]},
            {"which": [0.5]},
            {"masks": 256},
            {"custom_indices": 1 << 24},
        ):
            with self.assertRaises(ValueError):
                bvhd.TopLevel([bvhd.Reference(bytes(32), np.zeros(6))], **arguments)
        with self.assertRaises(ValueError):
            self.client.fetch([b"short"])

    def test_fetch_by_key(self):
        result = self.build(waves(5))
        with self.client.fetch([result.key, bytes(32)]) as batch:
            self.assertTrue(batch.wait())
            self.assertEqual(bytes(batch.result(0)), bytes(result))
            self.assertEqual(batch.error(1).status, bvhd.Status.NOT_FOUND)
            self.assertEqual(len(batch), 2)

    def test_lifetimes(self):
        result = bvhd.Client(connect_timeout=30).build(waves(6))
        copy = bytes(result)
        data, array = result.data, result.array
        del result
        gc.collect()
        self.assertEqual(bytes(data), copy)
        del data
        gc.collect()
        self.assertEqual(array.tobytes(), copy)

    def test_objects_end_in_any_order(self):
        client = bvhd.Client(connect_timeout=30)
        batches = [client.submit([waves(8)]) for _ in range(3)]
        client.close()
        for call in (client.ping, client.fileno, batches[0].wait, lambda: batches[1].result(0)):
            with self.assertRaises(ValueError):
                call()
        client.close()
        batches[2].close()

    def test_memory_is_kept_until_it_is_copied(self):
        batch = self.client.submit([waves(40)])
        self.assertTrue(batch.wait_copied(60))
        self.assertTrue(batch.is_copied)
        self.assertTrue(0 <= batch.progress() <= 1)
        self.assertEqual(batch._arrays, [])
        self.assertEqual(batch.results()[0].statistics["triangles"], 3200)
        self.assertEqual([batch.progress(0), batch.progress(1)], [1, 0])

    def test_waits_end(self):
        batch = self.client.submit([waves(400)], quality=bvhd.Quality.HIGH)
        began = time.monotonic()
        if not batch.wait(0):
            self.assertLess(time.monotonic() - began, 30)
        batch.cancel(0)
        self.assertTrue(batch.is_done)
        self.assertIn(batch.error(0) and batch.error(0).status, (None, bvhd.Status.CANCELLED))

    def test_deadline(self):
        mesh = waves(400)
        batch = self.client.submit([mesh], quality=bvhd.Quality.HIGH, deadline=0.001)
        self.assertTrue(batch.wait())
        error = batch.error(0)
        self.assertEqual((error.status, error.where), (bvhd.Status.CANCELLED, "deadline"))
        self.assertEqual(self.build(waves(12), deadline=3600).statistics["triangles"], 2 * 12 * 12)

    def test_close_while_another_thread_waits(self):
        batch = self.client.submit([waves(300)], quality=bvhd.Quality.HIGH)
        ends = []

        def wait():
            try:
                ends.append(batch.wait())
            except ValueError:
                ends.append("closed")

        threads = [threading.Thread(target=wait) for _ in range(3)]
        for thread in threads:
            thread.start()
        batch.close()
        for thread in threads:
            thread.join(60)
        self.assertEqual(len(ends), 3)

    def test_keyboard_interrupt(self):
        with tempfile.TemporaryDirectory() as folder:
            silent = bvhd.Client(
                os.path.join(folder, "none"), connect_timeout=60, local=bvhd.Local.NEVER
            )
            self.addCleanup(silent.close)
            batch = silent.submit([waves(3)])
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
            began = time.monotonic()
            with self.assertRaises(KeyboardInterrupt):
                batch.wait()
            self.assertLess(time.monotonic() - began, 30)

    def test_event_loop(self):
        with self.client.submit([waves(10)]) as batch:
            while not batch.is_done:
                ready, _, _ = select.select([self.client], [], [], 60)
                self.assertEqual(ready, [self.client])
                self.client.dispatch()
            self.assertEqual(batch.result().statistics["triangles"], 200)

    def test_callback(self):
        called = []

        def done(batch):
            called.append(batch.result().statistics["triangles"])
            batch.close()  # which destroys it after this call

        batch = self.client.submit([waves(4)])
        batch.set_callback(done)
        batch.wait()
        self.client.ping(30)
        self.assertEqual(called, [32])
        with self.assertRaises(ValueError):
            batch.wait()
        dropped = self.client.submit([waves(5)])
        dropped.set_callback(done)
        dropped.close()
        self.client.ping(30)
        self.assertEqual(called, [32])

    def test_service(self):
        self.client.connect()
        self.assertGreater(self.client.ping(30), 0)
        self.assertIn("misses", self.client.counters(30))
        self.assertRegex(self.client.daemon_version(30), r"^\d+\.\d+\.\d+$")
        (own,) = (row for row in self.client.connections(True, 30) if row["pid"] == os.getpid())
        self.assertEqual(own["uid"], os.getuid())
        self.assertIn("libbvhd", own["software"])
        kept = self.client.cache(timeout=30)
        self.assertEqual(kept["directory"], "")
        self.assertGreater(kept["memory_budget"], 0)
        self.client.cache(bvhd.CacheAction.CLEAR, timeout=30)
        with self.assertRaises(bvhd.Error) as raised:
            self.client.cache(bvhd.CacheAction.TRIM, 0, 30)
        self.assertEqual(raised.exception.status, bvhd.Status.UNSUPPORTED)

    def test_formats(self):
        with self.assertRaises(bvhd.Error) as raised:
            bvhd.Format(b"no probe")
        self.assertEqual(raised.exception.status, bvhd.Status.CORRUPT)

    def test_no_daemon(self):
        with tempfile.TemporaryDirectory() as folder:
            with bvhd.Client(
                os.path.join(folder, "none"), connect_timeout=0.1, local=bvhd.Local.NEVER
            ) as client:
                with self.assertRaises(bvhd.Error) as raised:
                    client.ping()
                self.assertEqual(raised.exception.status, bvhd.Status.UNAVAILABLE)


if __name__ == "__main__":
    unittest.main()
