# SPDX-License-Identifier: Apache-2.0
"""Tests of builds in this process, beside those of the daemon on $BVHD_SOCKET."""
import os
import select
import signal
import tempfile
import threading
import time
import unittest

import numpy as np

import bvhd
from test_client import CORNERS, FACES, waves


class LocalTest(unittest.TestCase):
    def client(self, *arguments, **options):
        client = bvhd.Client(*arguments, connect_timeout=30, **options)
        self.addCleanup(client.close)
        return client

    def test_the_same_bytes(self):
        requests = [waves(9), bvhd.Aabbs([[0, 0, 0, 1, 2, 3]])]
        served = self.client(local=bvhd.Local.NEVER)
        wanted = served.build(requests)
        wanted.append(served.build(bvhd.TopLevel(wanted, [0, 1, 1])))
        with tempfile.TemporaryDirectory() as folder:
            nowhere = os.path.join(folder, "none")
            for client in (
                self.client(local=bvhd.Local.ALWAYS),
                self.client(local=bvhd.Local.ALWAYS, local_threads=0),
                self.client(nowhere),
            ):
                results = client.build(requests)
                results.append(client.build(bvhd.TopLevel(results, [0, 1, 1])))
                self.assertEqual([bytes(one) for one in results], [bytes(one) for one in wanted])
                self.assertEqual([one.key for one in results], [one.key for one in wanted])

    def test_the_same_errors(self):
        texts = set()
        for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
            with self.assertRaises(bvhd.Error) as raised:
                self.client(local=local).build(bvhd.Triangles(CORNERS, [[0, 1, 4]]))
            texts.add(str(raised.exception))
        self.assertEqual(len(texts), 1, texts)

    def test_updates(self):
        flags = bvhd.BuildFlags.ALLOW_UPDATE
        frames = []
        for local in (bvhd.Local.NEVER, bvhd.Local.ALWAYS):
            client = self.client(local=local)
            mesh = bvhd.BottomLevel([bvhd.Triangles(CORNERS, FACES)], flags=flags)
            last = [client.build(mesh)]
            last.append(client.build(bvhd.TopLevel([last[0], last[0]], flags=flags)))
            for step in range(1, 4):
                moved = bvhd.Triangles(CORNERS * np.float32(1 + step), FACES)
                below = bvhd.BottomLevel([moved], flags=flags, source=last[0])
                above = bvhd.TopLevel([below, below], flags=flags, source=last[1].reference())
                last = client.build([below, above])
                self.assertEqual([one.statistics["refits"] for one in last], [step, step])
                self.assertGreater(last[0].statistics["decay"], 0)
                frames.append([bytes(one) for one in last])
            unknown = bvhd.Reference(bytes(range(32)))
            with self.assertRaises(bvhd.Error) as raised:
                client.build(bvhd.BottomLevel(mesh.geometries, flags, source=unknown))
            self.assertEqual(raised.exception.status, bvhd.Status.SOURCE_LOST)
        self.assertEqual(frames[:3], frames[3:])

    def test_fetch_while_a_batch_has_it(self):
        client = self.client(local=bvhd.Local.ALWAYS)
        with client.submit([bvhd.Triangles(CORNERS, FACES)]) as batch:
            (result,) = batch
            self.assertEqual(bytes(client.fetch([result.key]).results()[0]), bytes(result))

    def test_there_is_no_service(self):
        client = self.client(local=bvhd.Local.ALWAYS)
        for call in (client.connect, client.ping, client.counters):
            with self.assertRaises(bvhd.Error) as raised:
                call()
            self.assertEqual(raised.exception.status, bvhd.Status.UNAVAILABLE)

    def test_keyboard_interrupt(self):
        client = self.client(local=bvhd.Local.ALWAYS)
        batch = client.submit([waves(300)], quality=bvhd.Quality.HIGH)
        os_timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
        began = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            os_timer.start()
            while True:  # the signal may come after the end of the build
                batch.wait()
        self.assertLess(time.monotonic() - began, 60)
        os_timer.join()

    def test_event_loop(self):
        client = self.client(local=bvhd.Local.ALWAYS)
        with client.submit([waves(10)]) as batch:
            while not batch.is_done:
                select.select([client], [], [], 60)
                client.dispatch()
            self.assertEqual(batch.result().statistics["triangles"], 200)


if __name__ == "__main__":
    unittest.main()
