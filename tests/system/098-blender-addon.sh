#!/bin/bash
# The Blender add-on without Blender: its WebSocket, its messages, its thread, against servers that are not what they should be.
name=098
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy' 2> /dev/null || { echo "no python3 with numpy (apt-get install python3-numpy)"; exit 77; }
addon=$PWD/proto/clients/blender
export PYTHONPATH=$PWD/tests/blender

if "$py" -c 'import mypy' 2> /dev/null; then
    types() { (cd "$addon" && "$py" -m mypy --strict --ignore-missing-imports --cache-dir "$dir/mypy" -p pyrovox_blender > "$dir/mypy.log" 2>&1); }
    check types types
else
    echo "SKIP $name:types (apt-get install python3-mypy)"
fi
zipped() { # what Blender installs has all modules, as files, and the page that they stand on
    make -s B="$dir/build" "$dir/build/pyrovox-blender.zip" > "$dir/zip.log" 2>&1 && "$py" - "$dir/build/pyrovox-blender.zip" <<'PY'
import glob, os, sys, zipfile
z = zipfile.ZipFile(sys.argv[1])
want = {f"pyrovox_blender/{os.path.basename(n)}" for n in glob.glob("proto/clients/blender/pyrovox_blender/*.py")}
sys.exit({n for n in z.namelist() if not n.endswith("/")} != want or b"class Subscriber" not in z.read("pyrovox_blender/_page.py") or b"bl_info" not in z.read("pyrovox_blender/__init__.py"))
PY
}
check zip zipped
for what in addresses frames split mutated golden without_zmq answers hostile order stops; do
    check "$what" timeout "$patience" "$py" tests/blender/addon.py "$what"
done
exit $rc
