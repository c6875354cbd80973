"""What the browser's tests stand on: programs started and ended, recordings made, one check a line."""
import json
import os
import signal
import subprocess
import tempfile
import time
import traceback

import numpy as np


def flame(n, phase):
    """Puffs that wander, with noise; 8 % of the voxels are lit."""
    z, y, x = np.mgrid[0:n, 0:n, 0:n] / n
    v = np.zeros((n, n, n, 3), np.float32)
    for k in range(5):
        c = 0.5 + 0.05 * np.cos(phase + 2 * k), 0.5 + 0.05 * np.sin(phase + 3 * k), 0.25 + 0.1 * k
        v += np.exp(-((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2) / (2 * 0.08 ** 2))[..., None] * np.array((1, 0.6, 0.2), np.float32)
    v[v < 0.08] = 0
    return v * (1 + 0.1 * np.random.default_rng(int(phase * 100)).standard_normal(v.shape).astype(np.float32))


def blobs(n, channels, seed):
    """A few soft balls and a sharp box, in a grid whose sides are no multiples of 8."""
    r, (nx, ny, nz) = np.random.default_rng(seed), n
    z, y, x = np.mgrid[0:nz, 0:ny, 0:nx].astype(float)
    v = np.zeros((nz, ny, nx, channels))
    for _ in range(4):
        c, s = r.uniform(0.25, 0.75, 3) * n, r.uniform(0.06, 0.15) * min(n)
        v += np.exp(-((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2) / (2 * s * s))[..., None] * r.uniform(0.3, 2, channels)
    v[v < 0.05] = 0
    v[3:7, 2:6, nx - 5:nx] = 1.5  # reaches the grid's side
    return v.astype(np.float16).astype(np.float32)


# What a camera sees every 20 nm from 400 nm (tests/lib/curves.h, the second), and its constants: soot of 1900 K is as bright
# in all three channels.
RESPONSE = np.array([[0, 0, .04, .03, .04, .04, .09, .06, .04, .47, .68, .46, .29, .15, .03, 0, 0], [0, .01, .16, .24, .43, .65, .94, .90, .67, .43, .18, .06, .03, .02, .01, 0, 0],
                     [0, .05, .81, .87, .82, .53, .22, .09, .03, .01, .01, 0, 0, 0, 0, 0, 0]])
METRES = np.arange(400, 720.5, 0.5) * 1e-9


def soot_light(kelvin):
    """Of each channel, for a volume fraction of 1 and constants of 1: Planck, and Rayleigh's absorption with E(m) = 0.26."""
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23
    light = 6 * np.pi * 0.26 / METRES * 2 * h * c ** 2 / METRES ** 5 / np.expm1(h * c / k / METRES / kelvin)
    return np.array([np.trapz(np.interp(METRES, np.arange(400, 721, 20) * 1e-9, s) * light, METRES) for s in RESPONSE])


CONSTANT = 1e6 / soot_light(1900.0)  # 1 ppm is 1/m


def spectral(constant=CONSTANT):
    """`spectral:` of rig.yaml; constants are known to 1 %."""
    rows = "".join(f"  {n}: {[float(x) for x in s]}\n" for n, s in zip(("red", "green", "blue"), RESPONSE))
    return f"spectral:\n  from: 400\n  step: 20\n{rows}  constant: {[float(x) for x in constant]}\n  covariance: [1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4]\n  absolute: true\n"


def sooty(kelvin, ppm):
    """Emission [z][y][x][3] of soot."""
    at = np.arange(1000, 2600, 2.0)
    table = np.array([soot_light(t) for t in at]) * CONSTANT * 1e-6
    return ppm[..., None] * np.stack([np.interp(kelvin, at, table[:, q]) for q in range(3)], -1)


class Bed:
    def __init__(self, build, label="view"):
        self.build, self.label = build, label
        self.bin = f"{build}/bin"
        self.shots = f"{build}/view"
        self.tmp = tempfile.TemporaryDirectory(prefix="pyrovox-view-", ignore_cleanup_errors=True)
        self.dir = self.tmp.name
        self.started = []
        self.passed = self.failed = 0

    def start(self, *command, log="log", env=None):
        with open(f"{self.dir}/{log}", "ab") as f:
            p = subprocess.Popen(command, stdout=subprocess.PIPE if log == "view" else f, stderr=f, start_new_session=True,
                                 env={**os.environ, **(env or {})})
        self.started.append(p)
        return p

    def view(self, *arguments):
        """A bridge: (process, its address)."""
        p = self.start(f"{self.bin}/pyrovox", "view", "--listen", "127.0.0.1:0", *arguments, log="view")
        url = p.stdout.readline().decode().strip()
        assert url.startswith("http"), open(f"{self.dir}/view").read()
        return p, url

    def end(self, p, how=signal.SIGTERM):
        if p.poll() is None:
            os.killpg(p.pid, how)
            try:
                p.wait(60)
            except subprocess.TimeoutExpired:
                os.killpg(p.pid, signal.SIGKILL)
                p.wait()

    def close(self):
        for p in self.started:
            self.end(p)
        self.tmp.cleanup()

    def run(self, *command):
        r = subprocess.run(command, capture_output=True, text=True, timeout=600)
        assert r.returncode == 0, (command, r.stdout[-800:], r.stderr[-800:])
        return r.stdout

    def rig(self, voxels, basis="box", cameras=4):
        path = f"{self.dir}/rig-{voxels}-{basis}.yaml"
        with open("tests/data/rig4.yaml") as f:
            text = f.read()
        head, tail = text.split("cameras:", 1)
        with open(path, "w") as f:
            f.write(f"version: 1\nvolume: {{ min: [-0.5, -0.5, 0], max: [0.5, 0.5, 1], voxels: [{voxels}, {voxels}, {voxels}], basis: {basis} }}\ncameras:{tail}")
        return path

    def daemon(self, rig, fps=10, fmt="rgb8", more=""):
        """Simulated GigE cameras and a daemon, in a network of their own; its endpoint."""
        at = f"ipc://{self.dir}/volumes"
        with open(f"{self.dir}/pyrovoxd.yaml", "w") as f:
            f.write(f'rig: {rig}\ncameras: "aravis:127.0.0.2+"\nfps: {fps}\npixel_format: {"RGB8" if fmt == "rgb8" else "Mono8"}\nshared_clock: true\n'
                    f'photometry: {{ black: 0.02 }}\npublish:\n  endpoints: ["{at}"]\ncontrol:\n  endpoint: "ipc://{self.dir}/control"\n{more}')
        p = self.start(f"{self.bin}/pyrovox", "simcams", "--private-net", "--rig", rig, "--format", fmt, "--fps", str(fps), "--ring", str(2 * fps), "--",
                       f"{self.bin}/pyrovoxd", "--config", f"{self.dir}/pyrovoxd.yaml", log="daemon", env={"PYROVOX_CACHE": f"{self.dir}/cache"})
        return p, at

    def recording(self, name, volumes, basis, lo=(-0.5, -0.4, 0.1), hi=(0.5, 0.4, 1.3)):
        """A folder of .npy with its .json, as `pyrovox reconstruct` leaves it."""
        folder = f"{self.dir}/{name}"
        os.makedirs(folder)
        for i, v in enumerate(volumes):
            v = np.asarray(v, np.float32)
            if v.ndim == 3:
                v = v[..., None]
            nz, ny, nx, c = v.shape
            n = (nx, ny, nz)
            np.save(f"{folder}/{i:06d}.npy", v)
            with open(f"{folder}/{i:06d}.json", "w") as f:
                json.dump({"set": i, "shape": list(v.shape), "origin": list(lo), "spacing": [(h - l) / s for l, h, s in zip(lo, hi, n)], "basis": basis,
                           "units": "1/m", "t_exposure_ns": 1767225600000000000 + i * 100000000, "t_publish_ns": 1767225600000000000 + i * 100000000,
                           "spread_ns": 0, "latency_ns": 5000000, "cameras_present": 8, "camera_mask": "00000000000000ff", "session": "0000000000000007",
                           "rig_hash": "0000000000000001", "software": "bed", "sample": "float16", "clamped": False,
                           "report": {"status": "converged", "solver": "none", "iterations": 1, "rel_residual": 0.01, "active_voxels": int((v != 0).sum()),
                                      "active_rays": 1, "entries": 1, "ms": {"photometry": 0, "hull": 0, "restrict": 0, "solve": 0, "total": 0}}}, f)
        with open(f"{folder}/recording.json", "w") as f:
            json.dump({"format": "pyrovox volumes", "version": 1, "session": "0000000000000007", "fps": 10, "n_cameras": 8, "closed": True, "gaps": []}, f)
        return folder

    def check(self, name, what):
        t0 = time.monotonic()
        try:
            what()
        except Exception:  # a check that fails does not keep the others from running
            traceback.print_exc()
            print(f"FAIL {self.label}:{name}", flush=True)
            self.failed += 1
        else:
            print(f"PASS {self.label}:{name} ({time.monotonic() - t0:.0f} s)", flush=True)
            self.passed += 1
