#!/bin/bash
# compute: sets on an OpenCL device, here pocl: chosen, refused and listed as it should be; the volumes of the processors; a device
# that fails or hangs at any time costs no set, and is said once.
name=116
. "$(dirname "$0")/lib.sh"
shim=$b/tests/opencl
[ -e "$shim/libOpenCL.so.1" ] || { echo "FAIL $name: $shim/libOpenCL.so.1 is not there: make test builds it"; exit 1; }
export POCL_CACHE_DIR=$shim/cache # of all tests: pocl compiles slowly
export PYROVOX_OPENCL_PATIENCE=600 # a busy machine is no device that hangs
mkdir -p "$POCL_CACHE_DIR" "$dir/none"
echo > "$dir/none/libOpenCL.so.1" # a library that cannot be loaded
top=$PWD
conf() { (cd "$top" && config "$@"); }
cd "$dir" || exit 1
device() { "$pyrovox" cpu | sed -n 's/^device    \(pthread[^:]*\): .*/\1/p'; } # pocl's own name of it

frames() { "$pyrovox" simcams --cameras 5 --size 64x48 --ring 6 --voxels 16 --write-rig rig.yaml --write-frames take > frames.log 2>&1; }
check frames frames
solve() { # out, options...: the volumes of the recording; a warning is a line with the device's name
    local to=$1; shift
    rm -rf "$to"
    run "$pyrovox" reconstruct --rig "${of:-rig.yaml}" --frames take --black 0.02 --selfcal off --out "$to" --quiet --save-report "$to.json" "$@"
}

# ---- which devices there are ----
listed() {
    run "$pyrovox" cpu
    says 0 'memory    ' 'a processor, used only by its name' 'Portable Computing Language' ' GB/s from the host' || return 1
    run "$pyrovox" doctor --sample 0 --all; [ "$code" -le 2 ] && grep -q 'used only by its name' <<< "$out"
}
check listed listed
without_a_library() {
    run env LD_LIBRARY_PATH="$dir/none" "$pyrovox" cpu; says 0 'device    none besides the processors: OpenCL cannot be loaded' 'ocl-icd-libopencl1' || return 1
    conf none.yaml <<< $'cameras: "sim:"\ncompute: opencl'
    run env LD_LIBRARY_PATH="$dir/none" "$pyrovoxd" --config none.yaml --check-config; says 1 'none.yaml: compute: opencl: OpenCL cannot be loaded' 'ocl-icd-libopencl1' || return 1
    run env LD_LIBRARY_PATH="$dir/none" "$pyrovox" doctor --sample 0 --config none.yaml; says 2 'there is no graphics card that can be used' || return 1
    LD_LIBRARY_PATH="$dir/none" solve no --compute opencl; says 1 'ocl-icd-libopencl1' || return 1
    LD_LIBRARY_PATH="$dir/none" solve quiet --compute cpu; says 0 && [ -z "$out" ] && [ -e quiet/000005.npy ] || return 1
    run env LD_LIBRARY_PATH="$dir/none" "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out auto0 --compute auto
    says 0 'compute: the processors; OpenCL cannot be loaded' '6 volumes'
}
check without_a_library without_a_library

# ---- what is refused ----
refused() { # the rest of a configuration, texts...
    conf no.yaml <<< "cameras: \"sim:\"
$1"
    shift
    run "$pyrovoxd" --config no.yaml; says 1 "$@" || return 1
    run "$pyrovoxd" --config no.yaml --check-config; says 1 "$@"
}
wrong_names() {
    refused 'compute: gpu' "no.yaml:5: compute: 'gpu' is not one of auto|cpu|opencl[:NAME]" || return 1
    refused 'compute: "opencl:nosuch"' 'compute: opencl:nosuch: OpenCL knows no device "nosuch"; there are: ' "$(device)" || return 1
    refused 'compute: opencl' 'OpenCL knows no graphics card' "$(device)" || return 1
    solve no --compute gpu; says 2 "'gpu' is not one of auto|cpu|opencl[:NAME]" || return 1
    solve no --compute opencl:nosuch; says 1 'there are: ' "$(device)" && [ ! -e no ]
}
check wrong_names wrong_names
wrong_together() {
    local k=$'compute: "opencl:portable"\n' says='only the processors can do this: '
    refused "${k}model: {temporal: on}" "$says" 'previous volume' 'say cpu or auto' || return 1
    refused "${k}model: {saturated: at-least}" "$says" 'lower bounds' || return 1
    refused "${k}model: {error_bars: true}" "$says" 'error bars' || return 1
    refused "${k}solver: {name: mlem}" "$says" 'a solver for comparison' || return 1
    refused "${k}solver: {stop: lcurve}" "$says" 'L-curve' || return 1
    solve no --compute opencl:portable --error-bars; says 2 "$says" 'error bars' || return 1
    solve no --compute opencl:portable --temporal; says 2 "$says" || return 1
    solve no --compute opencl:portable --plan; says 2 '--plan' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out auto1 --compute auto --error-bars=4 --last 0
    says 0 'compute: the processors, which alone can do this: error bars'
}
check wrong_together wrong_together

# ---- the same volumes ----
same() { # folder, folder of the processors (here): the volumes of the first against those of the second.  4e-3 is the share by which the solver's own stop lets x move
    "$py" - "$1" "${2:-here}" << 'END'
import glob, os, sys
import numpy as np
worst, names = 0, sorted(os.path.basename(n) for n in glob.glob(sys.argv[2] + "/*.npy"))
assert names == sorted(os.path.basename(n) for n in glob.glob(sys.argv[1] + "/*.npy")) and len(names) == 6, names
for n in names:
    a, b = np.load(sys.argv[2] + "/" + n).astype(float), np.load(sys.argv[1] + "/" + n).astype(float)
    assert a.any() and ((a != 0) <= (b != 0) + (abs(a) < 1e-3 * a.max())).all()
    worst = max(worst, np.sqrt(((a - b)**2).sum() / (a**2).sum()))
print("figures 116: difference %.1e" % worst)
assert worst <= 4e-3, worst
END
}
told() { # expression of the report's c
    "$py" -c 'import json, sys; c = json.load(open(sys.argv[1])).get("compute"); sys.exit(not eval(sys.argv[2]))' "$1.json" "$2"
}
volumes_of_pocl() {
    solve here; says 0 && told here 'c is None' || return 1
    solve there --compute opencl:portable; says 0 || return 1
    [ -z "$(grep -v 'compiles the kernels, once' <<< "$out")" ] || { echo "  said: $out"; return 1; }
    told there 'c["device"].startswith("pthread") and c["sets"] == c["raw"] == 6 and c["fell_back"] == 0 and c["why"] == ""' && same there
}
check volumes_of_pocl volumes_of_pocl
calibrated_cameras() { # responses, colours and masks: their pixels are unpacked there too
    "$py" -c 'import numpy as n; m = n.full((48, 64), 255, n.uint8); m[:9, :20] = m[22, 33] = 0; n.save("mask.npy", m)'
    sed 's|^    t: |    photometry: {response: [0, 0.3, 0.7, 1], matrix: [1.05, 0, 0, 0, 0.95, 0.02, 0, 0.01, 1], mask: mask.npy}\n&|' rig.yaml > calibrated.yaml
    of=calibrated.yaml solve as_calibrated; says 0 || return 1
    of=calibrated.yaml solve there --compute opencl:portable; says 0 || return 1
    told there 'c["sets"] == c["raw"] == 6' && same there as_calibrated && ! cmp -s here/000000.npy as_calibrated/000000.npy
}
check calibrated_cameras calibrated_cameras
pocl_is_not_chosen() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out auto2 --compute auto
    says 0 'compute: the processors; OpenCL knows no graphics card; by name there are: '
}
check pocl_is_not_chosen pocl_is_not_chosen

# ---- devices that fail ----
# fault N of a function, in a run of all sets: nothing is lost, one warning, exit 0
fault() { # FUNCTION:N:WHAT
    local seconds=$PYROVOX_OPENCL_PATIENCE at
    [ "${1##*:}" != hang ] || seconds=10
    rm -f said
    LD_LIBRARY_PATH=$shim PYROVOX_CL_FAULT=$1 PYROVOX_CL_SAID=$dir/said PYROVOX_OPENCL_PATIENCE=$seconds solve fault --compute opencl:portable
    says 0 || return 1
    at=${1#*:}
    grep -q " ${at%%:*}$" said || { echo "  $1 did not happen"; return 1; }
    [ "$(grep -cE 'recon: .*because of pthread|^compute: ' <<< "$out")" = 1 ] || { echo "  $1: not one warning: $out"; return 1; }
    ! grep -q 'because of \(pthread[^:]*\): \1' <<< "$out" || { echo "  $1: named twice: $out"; return 1; }
    same fault > /dev/null || { echo "  $1: other volumes"; return 1; }
}
calls() { # how often each function is called in a run without fault
    rm -f said
    LD_LIBRARY_PATH=$shim PYROVOX_CL_FAULT=$1:0:error PYROVOX_CL_SAID=$dir/said solve fault --compute opencl:portable
    says 0 && same fault > /dev/null && n=$(sed -n 's/^any //p' said) && [ "$n" -gt 100 ]
}
while_it_starts() {
    fault clCreateContext:1:error && fault clCreateBuffer:1:error && fault clCreateBuffer:5:-4 && fault clEnqueueWriteBuffer:1:event
}
check fails-while-it-starts while_it_starts
while_it_runs() {
    calls any || return 1
    echo "figures 116: $n calls of OpenCL in 6 sets"
    local part
    for part in 30 60 68 76 84 92; do # at 30 the device is still checked
        fault any:$((n * part / 100)):error || return 1
    done
    fault any:$((n * 65 / 100)):event && fault any:$((n * 85 / 100)):event
}
check fails-while-it-runs while_it_runs
while_it_hangs() { fault any:$((n * 70 / 100)):hang && fault any:$((n * 88 / 100)):hang; }
check hangs while_it_hangs

# ---- live ----
live() { # log, environment...: a daemon on pocl
    local log=$1; shift
    start "$log" env "$@" "$pyrovoxd" --config live.yaml
}
conf live.yaml <<< $'cameras: "sim:"\nfps: 4\ngrid: 16\ncompute: "opencl:portable"\nmetrics: {endpoint: "127.0.0.1:0"}'
solves_live() {
    live live.log
    wait_for field 's["compute"]["sets"] >= 8 and s["compute"]["raw"] == s["compute"]["sets"] and s["compute"]["fell_back"] == 0 and s["compute"]["device"].startswith("pthread")' || return 1
    run "$pyrovox" status --endpoint "$control"; says 0 'compute   pthread' || return 1
    run "$pyrovox" ctl --control "$control" set solver.stop lcurve; says 1 'only the processors can do this' || return 1
    kill "$started" && ended "$started" 0 && grep -q 'compute: pthread.*, driver ' live.log
}
check solves_live solves_live
survives_live() { # WHAT, seconds of patience
    live fault.log LD_LIBRARY_PATH="$shim" PYROVOX_CL_FAULT="clEnqueueNDRangeKernel:3000:$1" PYROVOX_OPENCL_PATIENCE="$2"
    wait_for field 's["compute"]["sets"] >= 1 and s["compute"]["fell_back"] >= 8 and s["compute"]["why"] != ""' || return 1
    field 'all(d["value"] == 0 for d in s["drops"] if d["name"] == "failed")' || return 1
    run "$pyrovox" status --endpoint "$control"; says 0 'on the processors instead: ' || return 1
    kill "$started" && ended "$started" 0 && [ "$(grep -c 'because of pthread' fault.log)" = 1 ]
}
check survives-an-error survives_live error 600
check survives-a-hang survives_live hang 10
exit $rc
