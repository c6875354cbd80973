"""What the add-on takes from published to Volume.filepath set: bench.py BUILD.  `make bench ONLY=blender`; no test, as it wants a quiet machine.

The recordings of tests/view/bench.py, played by a bridge, which packs each volume itself from the stamp of publishing on.  Blender is in
the background and its timer called as it asks to be; what its screen takes is not in it."""
import json
import os
import shutil
import subprocess
import sys

import numpy as np

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../view"))
from bed import Bed, flame  # noqa: E402

if not shutil.which("blender"):
    print("NOT RUN blender: blender is not installed (make test-blender does that)")
    sys.exit(77)
bed = Bed(os.path.realpath(sys.argv[1]))


try:
    print("| what, two cores | measured | wanted |\n|---|---|---|")
    subprocess.run(["make", "-s", "blender-addon", f"B={sys.argv[1]}"], check=True, stdout=subprocess.DEVNULL)
    for n in (64, 128):
        bridge, url = bed.view(bed.recording(f"flame-{n}", [flame(n, 0.3 * i) for i in range(10)], "trilinear", (-0.5, -0.5, 0), (0.5, 0.5, 1)))
        bed.run("env", f"BLENDER_USER_CONFIG={bed.dir}/config", f"BLENDER_USER_SCRIPTS={bed.dir}/scripts", f"TMPDIR={bed.dir}", "blender", "--background", "--factory-startup",
                "--python-exit-code", "3", "--python", "tests/blender/inside.py", "--", "latency", bed.dir, f"{bed.build}/pyrovox-blender.zip", url)
        with open(f"{bed.dir}/found.json") as f:
            ms = np.array(json.load(f)["ms"])
        print(f"| published to Volume.filepath set, {n}^3, {len(ms)} volumes at 10 Hz: p50, p95 | {np.median(ms):.0f}, {np.percentile(ms, 95):.0f} ms | {'100 ms' if n == 64 else ''} |")
        bed.end(bridge)
finally:
    bed.close()
