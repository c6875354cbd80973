"""exchange.py CASE PYROVOX FOLDER: a calibration that another program wrote, imported, against that program's own projection.

The truth is a ring of cameras in OpenCV's convention.  Each case writes it through a program (OpenCV, COLMAP, h5py as MATLAB
lays it out, ...), lets `pyrovox calibrate import` read it, and projects the same points through rig.yaml by cv2.
The limit is 0.01 px."""
import json
import os
import pathlib
import shutil
import subprocess
import sys

import cv2
import numpy as np

case, pyrovox, folder = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
rng = np.random.default_rng(5)
POINTS = rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.3], (50, 3))  # m
BOX = "-0.3,-0.3,0.7,0.3,0.3,1.3"
LIMIT = 0.01


class Camera:
    def __init__(self, name, K, dist, R, t, size, fisheye=False):
        self.name, self.K, self.dist, self.R, self.t, self.size, self.fisheye = name, np.array(K, float), np.array(dist, float), np.array(R, float).reshape(3, 3), np.array(t, float).reshape(3), size, fisheye

    def project(self, X):
        """cv2's pixels of points in metres."""
        rvec = cv2.Rodrigues(self.R)[0]
        if self.fisheye:
            return cv2.fisheye.projectPoints(X.reshape(-1, 1, 3), rvec, self.t.reshape(3, 1), self.K, self.dist[:4])[0].reshape(-1, 2)
        return cv2.projectPoints(X, rvec, self.t, self.K, self.dist)[0].reshape(-1, 2)


def ring(n, dist, fisheye=False):
    """n cameras that look at (0, 0, 1) from 2 to 3 m, each turned a little about its axis."""
    cameras = []
    for i in range(n):
        a = 2 * np.pi * i / max(n, 3) + 0.3
        at = np.array([2.5 * np.cos(a), 2.2 * np.sin(a), 0.4 + 0.5 * i])
        z = np.array([0.02 * i, 0.03, 1.0]) - at
        z /= np.linalg.norm(z)
        x = np.cross(z, [0.1, 0.05, 1])
        x /= np.linalg.norm(x)
        R = np.array([x, np.cross(z, x), z])
        K = [[900.5 + 7 * i, 0, 310.25 + i], [0, 905.75 - 3 * i, 251.5], [0, 0, 1]]
        cameras.append(Camera(f"cam{i}", K, dist, R, -R @ at, (640, 480), fisheye))
    return cameras


PINHOLE = [-0.21, 0.12, 0.0013, -0.0021, -0.03]
RATIONAL = [0.31, 0.12, 0.0013, -0.0021, 0.03, 0.5, 0.17, 0.02]
TILTED = [*RATIONAL, 0, 0, 0, 0, 0.03, -0.02]
FISHEYE = [0.05, -0.02, 0.01, -0.003]


def calibrate(*arguments, code=0):
    r = subprocess.run([pyrovox, "calibrate", *map(str, arguments)], capture_output=True, text=True)
    if r.returncode != code:
        sys.exit(f"{arguments}: exit {r.returncode}, want {code}\n{r.stdout}{r.stderr}")
    return r.stdout + r.stderr


def load(path):
    """rig.yaml by its documentation (rig.h); the file is simple enough for a line reader."""
    cameras, one = [], {}
    for line in open(path):
        line = line.split(" #")[0].strip().removeprefix("- ")
        key, _, value = line.partition(": ")
        if key == "name":
            one = {"name": value}
            cameras.append(one)
        elif cameras and value:
            one[key] = json.loads(value) if value[0] == "[" else value
    return {c["name"]: Camera(c["name"], [[c["K"][0], 0, c["K"][2]], [0, c["K"][1], c["K"][3]], [0, 0, 1]], c.get("distortion", [0] * 5), c["R"], c["t"], tuple(c["size"]), c.get("model") == "fisheye") for c in cameras}


def agrees(truth, files, *options, names=None, box=BOX):
    """The imported cameras are the true ones, to LIMIT px."""
    out = folder / f"{case}-rig.yaml"
    said = calibrate("import", *files, "--out", out, "--force", "--volume", box, *options)
    rig = load(out)
    for i, c in enumerate(truth):
        got = rig[names[i] if names else c.name]
        off = np.abs(got.project(POINTS) - c.project(POINTS)).max()
        if not off < LIMIT or got.size != c.size:
            sys.exit(f"{case}: {c.name} is off by {off:.4f} px, size {got.size}\n{said}")
    if len(rig) != len(truth):
        sys.exit(f"{case}: {len(rig)} cameras, want {len(truth)}")
    return said


def agrees_in_first(truth, files, *options):
    """The same for a format whose world is the first camera."""
    global POINTS
    a = truth[0]
    world, POINTS = POINTS, POINTS @ a.R.T + a.t
    moved = [Camera(c.name, c.K, c.dist, c.R @ a.R.T, c.t - c.R @ a.R.T @ a.t, c.size, c.fisheye) for c in truth]
    agrees(moved, files, *options, box=",".join(f"{v:.3f}" for v in (*POINTS.min(0), *POINTS.max(0))))
    POINTS = world


def storage(path, cameras, **more):
    f = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for c in cameras:
        f.startWriteStruct(c.name, cv2.FileNode_MAP)
        f.write("image_width", c.size[0])
        f.write("image_height", c.size[1])
        if c.fisheye:
            f.write("fisheye_model", 1)
        f.write("camera_matrix", c.K)
        f.write("distortion_coefficients", c.dist.reshape(1, -1))
        f.write("R", c.R)
        f.write("T", c.t.reshape(3, 1))
        f.endWriteStruct()
    for key, value in more.items():
        f.write(key, value)
    f.release()


def opencv():
    for dist, fisheye in ((PINHOLE, False), (RATIONAL, False), (TILTED, False), (FISHEYE, True)):
        truth = ring(4, dist, fisheye)
        for end in ("yml", "xml", "json"):
            path = folder / f"opencv.{end}"
            storage(path, truth)
            agrees(truth, [path], "--unit", "m")


def inverted():
    """Poses from the camera to the world are refused, with the cause and the remedy, and nothing is written."""
    truth = ring(4, PINHOLE)
    for c in truth:
        c.R, c.t = c.R.T, -c.R.T @ c.t
    storage(folder / "inverted.yml", truth)
    said = calibrate("import", folder / "inverted.yml", "--unit", "m", "--volume", BOX, "--out", folder / "inverted.yaml", code=1)
    assert "4 of 4 would see it if R and t lead from the camera to the world (give R transposed and -R^T t)" in said, said
    assert not (folder / "inverted.yaml").exists()


def opencv_stereo():
    """The two files of OpenCV's stereo_calib, in millimetres; the first camera is the world."""
    truth = ring(2, PINHOLE)
    a, b = truth
    R = b.R @ a.R.T
    t = b.t - R @ a.t
    one, two = folder / "intrinsics.yml", folder / "extrinsics.yml"
    f = cv2.FileStorage(str(one), cv2.FILE_STORAGE_WRITE)
    for key, value in (("M1", a.K), ("D1", a.dist.reshape(1, -1)), ("M2", b.K), ("D2", b.dist.reshape(1, -1))):
        f.write(key, value)
    f.release()
    f = cv2.FileStorage(str(two), cv2.FILE_STORAGE_WRITE)
    R1, R2, P1, P2, Q = cv2.stereoRectify(a.K, a.dist, b.K, b.dist, a.size, R, 1000 * t.reshape(3, 1))[:5]
    for key, value in (("R", R), ("T", 1000 * t.reshape(3, 1)), ("R1", R1), ("R2", R2), ("P1", P1), ("P2", P2), ("Q", Q)):
        f.write(key, value)
    f.release()
    global POINTS
    POINTS = POINTS @ a.R.T + a.t  # in the first camera
    pair = [Camera("cam1", a.K, a.dist, np.eye(3), [0, 0, 0], a.size), Camera("cam2", b.K, b.dist, R, t, b.size)]
    low, high = POINTS.min(0), POINTS.max(0)
    box = ",".join(f"{v:.3f}" for v in (*low, *high))
    for files in ([one, two], [two, one]):
        agrees(pair, files, "--unit", "mm", "--size", "640x480", box=box)


def quaternion(R):
    v = cv2.Rodrigues(R)[0].ravel()
    a = np.linalg.norm(v)
    return np.array([np.cos(a / 2), *(np.sin(a / 2) * v / a)])


def colmap():
    """Text that COLMAP reads, what it writes as binary and as text, and its own projection: the cost before it adjusts."""
    if not shutil.which("colmap"):
        sys.exit(77)
    kinds = {"OPENCV": (PINHOLE[:4], False), "FULL_OPENCV": (RATIONAL, False), "OPENCV_FISHEYE": (FISHEYE, True),
             "RADIAL": ([-0.2, 0.1], False), "SIMPLE_RADIAL": ([-0.1], False), "PINHOLE": ([], False), "SIMPLE_PINHOLE": ([], False),
             "SIMPLE_RADIAL_FISHEYE": ([0.04], True), "RADIAL_FISHEYE": ([0.04, -0.01], True)}
    for model, (dist, fisheye) in kinds.items():
        truth = ring(3, list(dist) + [0] * (4 - len(dist)) if len(dist) < 4 else dist, fisheye)
        one = model.startswith(("SIMPLE", "RADIAL"))
        base = folder / f"colmap-{model}"
        for d in ("in", "bin", "txt"):
            (base / d).mkdir(parents=True, exist_ok=True)
        pixels = {}
        with open(base / "in/cameras.txt", "w") as f:
            for i, c in enumerate(truth):
                if one:
                    c.K[1, 1] = c.K[0, 0]
                pixels[i] = c.project(POINTS) + 0.5  # COLMAP's first pixel has its centre at 0.5
                K = [c.K[0, 0], c.K[0, 2] + 0.5, c.K[1, 2] + 0.5] if one else [c.K[0, 0], c.K[1, 1], c.K[0, 2] + 0.5, c.K[1, 2] + 0.5]
                print(i + 1, model, *c.size, *map(repr, map(float, [*K, *dist])), file=f)
        with open(base / "in/images.txt", "w") as f:
            for i, c in enumerate(truth):
                print(i + 1, *map(float, quaternion(c.R)), *map(float, c.t / 0.25), i + 1, f"{c.name}.png", file=f)
                print(*(f"{u!r} {v!r} {k + 1}" for k, (u, v) in enumerate(pixels[i].tolist())), file=f)
        with open(base / "in/points3D.txt", "w") as f:
            for k, X in enumerate(POINTS / 0.25):  # a unit of 0.25 m
                print(k + 1, *map(float, X), 9, 9, 9, 0, *(f"{i + 1} {k}" for i in range(len(truth))), file=f)
        for to in ("bin", "txt"):
            subprocess.run(["colmap", "model_converter", "--input_path", base / "in", "--output_path", base / to, "--output_type", to.upper()], check=True, capture_output=True)
            agrees(truth, [base / to], "--unit", "0.25")
        said = subprocess.run(["colmap", "bundle_adjuster", "--input_path", base / "bin", "--output_path", base / "txt", "--BundleAdjustment.max_num_iterations", "1"], check=True, capture_output=True, text=True, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})
        cost = [float(line.split(":")[1].split("[")[0]) for line in (said.stdout + said.stderr).splitlines() if "Initial cost" in line]
        if len(cost) != 1 or not cost[0] < LIMIT:
            sys.exit(f"{model}: COLMAP projects otherwise: {cost}\n{said.stdout}{said.stderr}")


def jarvis():
    """As JARVIS's calibration tool stores it: both matrices for row vectors, millimetres."""
    truth = ring(3, PINHOLE)
    files = []
    for c in truth:
        files.append(folder / f"{c.name}.yaml")
        f = cv2.FileStorage(str(files[-1]), cv2.FILE_STORAGE_WRITE)
        for key, value in (("intrinsicMatrix", c.K.T), ("distortionCoefficients", c.dist.reshape(1, -1)), ("R", c.R.T), ("T", 1000 * c.t.reshape(3, 1))):
            f.write(key, value)
        f.release()
        # its reader: cameraMatrix = (vstack(R, T) @ intrinsicMatrix).T
        f = cv2.FileStorage(str(files[-1]), cv2.FILE_STORAGE_READ)
        K, R, T = (f.getNode(k).mat() for k in ("intrinsicMatrix", "R", "T"))
        P = (np.vstack([R, T.reshape(1, 3)]) @ K).T
        p = np.hstack([1000 * POINTS, np.ones((len(POINTS), 1))]) @ P.T
        flat = Camera("", c.K, [0] * 5, c.R, c.t, c.size).project(POINTS)
        assert np.abs(p[:, :2] / p[:, 2:] - flat).max() < 1e-6
    agrees(truth, files, "--unit", "mm", "--size", "640x480")


def ros():
    """camera_info that ROS's camera_calibration_parsers wrote, and poses in a second file."""
    convert = "/usr/lib/camera_calibration_parsers/convert"
    for dist, model in ((PINHOLE, "plumb_bob"), (RATIONAL, "rational_polynomial")):
        truth = ring(3, dist)
        files = []
        for c in truth:
            matrix = lambda m: f"{{rows: {m.shape[0]}, cols: {m.shape[1]}, data: {[float(v) for v in m.ravel()]}}}"
            given = folder / f"{c.name}-given.yaml"
            given.write_text(f"image_width: 640\nimage_height: 480\ncamera_name: {c.name}\ncamera_matrix: {matrix(c.K)}\ndistortion_model: {model}\n"
                             f"distortion_coefficients: {matrix(c.dist.reshape(1, -1))}\nrectification_matrix: {matrix(np.eye(3))}\n"
                             f"projection_matrix: {matrix(np.hstack([c.K, np.zeros((3, 1))]))}\n")
            files.append(folder / f"{c.name}-ros.yaml")
            if os.access(convert, os.X_OK):
                subprocess.run([convert, given, files[-1]], check=True, capture_output=True)
            else:
                files[-1].write_text(given.read_text())
        poses = folder / "poses.yaml"
        poses.write_text("".join(f"{c.name}: {{R: {c.R.tolist()}, T: {c.t.tolist()}}}\n" for c in truth))
        agrees(truth, [*files, poses], "--unit", "m")
    # two rectified cameras: R and P have the poses, in the rectified frame of the first
    a, b = truth[:2]
    R, t = b.R @ a.R.T, b.t - b.R @ a.R.T @ a.t
    R1, R2, P1, P2 = cv2.stereoRectify(a.K, a.dist, b.K, b.dist, a.size, R, t.reshape(3, 1))[:4]
    pair = []
    for c, rect, P in ((a, R1, P1), (b, R2, P2)):
        given = folder / f"{c.name}-pair-given.yaml"
        given.write_text(f"image_width: 640\nimage_height: 480\ncamera_name: {c.name}\ncamera_matrix: {matrix(c.K)}\ndistortion_model: {model}\n"
                         f"distortion_coefficients: {matrix(c.dist.reshape(1, -1))}\nrectification_matrix: {matrix(rect)}\nprojection_matrix: {matrix(P)}\n")
        pair.append(folder / f"{c.name}-pair.yaml")
        if os.access(convert, os.X_OK):
            subprocess.run([convert, given, pair[-1]], check=True, capture_output=True)
        else:
            pair[-1].write_text(given.read_text())
    global POINTS
    world, POINTS = POINTS, (POINTS @ a.R.T + a.t) @ R1.T
    box = ",".join(f"{v:.3f}" for v in (*POINTS.min(0), *POINTS.max(0)))
    agrees([Camera("cam0", a.K, a.dist, R1.T, [0, 0, 0], a.size), Camera("cam1", b.K, b.dist, R @ R1.T, t, b.size)], pair, "--unit", "m", box=box)
    POINTS = world
    said = calibrate("import", *files, "--out", folder / "no.yaml", "--unit", "m", "--volume", BOX, code=1)
    assert "camera 'cam0' has a lens but no pose" in said, said


def kalibr():
    """A camchain as Kalibr's wiki describes it: T_cn_cnm1 leads from the camera before."""
    for dist, fisheye in ((PINHOLE[:4], False), (FISHEYE, True)):
        truth = ring(4, dist, fisheye)
        text, before = "", None
        for i, c in enumerate(truth):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = c.R, c.t
            text += (f"cam{i}:\n  camera_model: pinhole\n  distortion_coeffs: {list(map(float, c.dist))}\n  distortion_model: {'equidistant' if fisheye else 'radtan'}\n"
                     f"  intrinsics: {[float(v) for v in (c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2])]}\n  resolution: [640, 480]\n  rostopic: /cam{i}/image_raw\n  cam_overlaps: [1, 2]\n")
            if i > 0:
                text += "  T_cn_cnm1:\n" + "".join(f"  - {row}\n" for row in (T @ np.linalg.inv(before)).tolist())
            before = T
        path = folder / "camchain.yaml"
        path.write_text(text)
        agrees_in_first(truth, [path])


def anipose():
    """What aniposelib hands to the library toml, and that library's text where it is here."""
    for dist, fisheye in ((PINHOLE, False), (FISHEYE, True)):
        truth = ring(3, dist, fisheye)
        tables = {f"cam_{i}": {"name": c.name, "size": list(c.size), "matrix": c.K.tolist(), "distortions": c.dist.tolist(),
                               "rotation": cv2.Rodrigues(c.R)[0].ravel().tolist(), "translation": (1000 * c.t).tolist(), "fisheye": fisheye} for i, c in enumerate(truth)}
        tables["metadata"] = {"adjusted": False, "error": 0.25}
        path = folder / "calibration.toml"
        try:
            import toml
            path.write_text(toml.dumps(tables))
        except ImportError:
            path.write_text("\n".join(f"[{t}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in rows.items()) for t, rows in tables.items()))
        agrees(truth, [path], "--unit", "mm")


def caliscope():
    """A project of caliscope's own, with the points that it triangulated and saw: the mean miss is its residual."""
    project = pathlib.Path(os.environ.get("PYROVOX_DATA", "../shared/data")) / "calibration/caliscope_post_optimization"
    if not project.is_dir():
        sys.exit(77)
    out = folder / "caliscope.yaml"
    calibrate("import", project / "camera_array.toml", "--unit", "m", "--volume=-0.4,-0.4,-0.4,0.4,0.4,0.4", "--force", "--out", out)
    rig = load(out)
    charuco = project / "calibration/extrinsic/CHARUCO"
    xyz = {tuple(r[:3].astype(int)): r[3:6] for r in np.genfromtxt(charuco / "xyz_CHARUCO.csv", delimiter=",", skip_header=1)}
    seen = np.genfromtxt(charuco / "xy_CHARUCO.csv", delimiter=",", skip_header=1)
    off = []
    for r in seen:
        key = (int(r[0]), int(r[2]), int(r[3]))
        if key in xyz:
            off.append(np.linalg.norm(rig[f"cam_{int(r[1])}"].project(xyz[key][None])[0] - r[4:6]))
    if not (len(off) > 100 and np.median(off) < 2):
        sys.exit(f"{len(off)} points, median {np.median(off):.3f} px")


def matlab():
    """toStruct(stereoParameters) as save -v7.3 lays it out (columns as rows, a user block of 512 bytes), in millimetres."""
    import h5py
    truth = ring(2, PINHOLE)
    a, b = truth
    R, t = b.R @ a.R.T, b.t - b.R @ a.R.T @ a.t
    global POINTS
    POINTS = POINTS @ a.R.T + a.t
    pair = [Camera("cam1", a.K, a.dist, np.eye(3), [0, 0, 0], a.size), Camera("cam2", b.K, b.dist, R, t, b.size)]
    box = ",".join(f"{v:.3f}" for v in (*POINTS.min(0), *POINTS.max(0)))
    for new in (False, True):
        path = folder / "stereo.mat"
        with h5py.File(path, "w", userblock_size=512) as f:
            def put(group, name, m):
                m = np.atleast_2d(m)
                group.create_dataset(name, data=m.T).attrs["MATLAB_class"] = np.bytes_("double")
            s = f.create_group("s")
            for i, c in enumerate(pair, 1):
                g = s.create_group(f"CameraParameters{i}")
                K = c.K.copy()
                K[:2, 2] += 1  # the first pixel is (1, 1)
                put(g, "K" if new else "IntrinsicMatrix", K if new else K.T)
                put(g, "RadialDistortion", c.dist[[0, 1, 4]])
                put(g, "TangentialDistortion", c.dist[2:4])
                put(g, "ImageSize", [480.0, 640.0])
                g.create_dataset("WorldUnits", data=np.array([[ord(k)] for k in "millimeters"], np.uint16)).attrs["MATLAB_class"] = np.bytes_("char")
            put(s, "RotationOfCamera2", R.T)
            put(s, "TranslationOfCamera2", 1000 * t)
        with open(path, "r+b") as f:
            f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
        agrees(pair, [path], box=box)


def agisoft():
    """Metashape's XML by its manual: camera to chunk, chunk to world, its own order of p1 and p2."""
    truth = ring(3, PINHOLE) + ring(4, FISHEYE, True)[3:]
    truth[3].name = "fish"
    truth[3].K[1, 1] = truth[3].K[0, 0]
    s, W, o = 0.37, cv2.Rodrigues(np.array([0.3, -0.5, 0.2]))[0], np.array([0.4, -1.2, 0.3])
    sensors, cameras = "", ""
    for i, c in enumerate(truth):
        C = np.eye(4)
        C[:3, :3] = W.T @ c.R.T
        C[:3, 3] = W.T @ (-c.R.T @ c.t - o) / s
        k = dict(zip(("k1", "k2", "p2", "p1", "k3") if not c.fisheye else ("k1", "k2", "k3", "k4"), c.dist))
        values = {"f": c.K[1, 1], "cx": c.K[0, 2] + 0.5 - 320, "cy": c.K[1, 2] + 0.5 - 240, "b1": c.K[0, 0] - c.K[1, 1], **k}
        sensors += (f'<sensor id="{i}" label="s" type="frame"><resolution width="640" height="480"/><calibration type="{"fisheye" if c.fisheye else "frame"}" class="adjusted">'
                    f'<resolution width="640" height="480"/>' + "".join(f"<{n}>{float(v)!r}</{n}>" for n, v in values.items()) + "</calibration></sensor>\n")
        cameras += f'<camera id="{i}" sensor_id="{i}" component_id="0" label="{c.name}.png" enabled="true"><transform>{" ".join(map(repr, C.ravel().tolist()))}</transform></camera>\n'
        # the manual's formula, against cv2
        X = (POINTS - o) @ W / s
        x = (X - C[:3, 3]) @ C[:3, :3]
        x, y = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
        if c.fisheye:
            r = np.hypot(x, y)
            x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
        r2 = x * x + y * y
        v = {n: 0.0 for n in ("k3", "k4", "p1", "p2", "b1")} | values
        radial = 1 + v["k1"] * r2 + v["k2"] * r2**2 + v["k3"] * r2**3 + v["k4"] * r2**4
        xd = x * radial + v["p1"] * (r2 + 2 * x * x) + 2 * v["p2"] * x * y
        yd = y * radial + v["p2"] * (r2 + 2 * y * y) + 2 * v["p1"] * x * y
        u = np.stack([320 + v["cx"] + xd * (v["f"] + v["b1"]), 240 + v["cy"] + yd * v["f"]], 1)
        assert np.abs(u - 0.5 - c.project(POINTS)).max() < 1e-6
    path = folder / "cameras.xml"
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n<chunk label="Chunk 1" enabled="true">\n<sensors next_id="9">\n{sensors}</sensors>\n'
                    f'<components next_id="1" active_id="0"><component id="0" label="C"><transform><rotation>{" ".join(map(repr, W.ravel().tolist()))}</rotation>'
                    f'<translation>{" ".join(map(repr, o.tolist()))}</translation><scale>{s}</scale></transform></component></components>\n'
                    f'<cameras next_id="9" next_group_id="0">\n{cameras}<camera id="8" sensor_id="0" label="lost.png"/></cameras>\n</chunk>\n</document>\n')
    agrees(truth, [path], "--unit", "m")


def round_trips():
    """What export writes, import reads back; and OpenCV reads the FileStorage files."""
    for dist, fisheye in ((PINHOLE[:4] + [0], False), (FISHEYE, True)):
        truth = ring(4, dist, fisheye)
        path, rig = folder / "trip.yml", folder / "trip-rig.yaml"
        storage(path, truth)
        calibrate("import", path, "--unit", "m", "--volume", BOX, "--force", "--out", rig)
        for to in ("opencv", "kalibr", "colmap", "anipose") + (() if fisheye else ("jarvis",)):
            out = folder / f"trip-{to}"
            calibrate("export", "--rig", rig, "--to", to, "--out", out, "--force")
            files = sorted(out.iterdir()) if to == "jarvis" else [out]
            if to == "kalibr":
                agrees_in_first(truth, files)
                continue
            agrees(truth, files, "--unit", "mm" if to == "jarvis" else "m", *(("--from", to) if to == "anipose" else ()))
        f = cv2.FileStorage(str(folder / "trip-opencv"), cv2.FILE_STORAGE_READ)
        assert np.allclose(f.getNode("cam2").getNode("camera_matrix").mat(), truth[2].K) and f.getNode("cam2").getNode("T").mat().shape == (3, 1)
        if shutil.which("colmap"):
            subprocess.run(["colmap", "model_analyzer", "--path", folder / "trip-colmap"], check=True, capture_output=True)


globals()[case.replace("-", "_")]()
