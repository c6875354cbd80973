#!/bin/bash
# Calibrations that other programs wrote, imported, and exported again: exchange.py has the cases and the 0.01 px.
name=108
. "$(dirname "$0")/lib.sh"
"$py" -c 'import cv2, h5py' 2> /dev/null || { echo "no python3 with cv2 and h5py (apt-get install python3-opencv python3-h5py)"; exit 77; }
for case in opencv inverted opencv-stereo colmap jarvis ros kalibr anipose caliscope matlab agisoft round-trips; do
    "$py" tests/system/exchange.py "$case" "$pyrovox" "$dir" > "$dir/$case.log" 2>&1
    code=$?
    if [ $code = 77 ]; then echo "SKIP $name:$case (apt-get install colmap, or a project of caliscope in PYROVOX_DATA)"; continue; fi
    check "$case" test $code = 0
done
cd "$dir" || exit 1
out() { run "$pyrovox" calibrate import "$@" --out no.yaml; }
needs() { # text, files and options...: refused with this text, and nothing is written
    local text=$1; shift
    out "$@"
    says 1 "$text" && ! [ -e no.yaml ]
}
box=(--volume "-0.3,-0.3,0.7,0.3,0.3,1.3")
check asks-for-the-unit needs 'in which unit are the files' opencv.yml "${box[@]}"
check asks-for-the-volume needs 'where will the flame burn? --volume' opencv.yml --unit m
check shows-where-cameras-look needs "the cameras' axes pass nearest to 0.03" opencv.yml --unit m
check asks-for-the-size needs "camera 'cam0': how large are its pictures? --size cam0=WIDTHxHEIGHT" cam0.yaml cam1.yaml --from jarvis --unit mm "${box[@]}"
check a-size-that-is-not-the-files needs "pictures of 640x480 in its file, and --size says 320x240: K belongs to one size" opencv.yml --unit m --size 320x240 "${box[@]}"
check a-size-for-the-others needs 'where will the flame burn' cam0.yaml cam1.yaml cam2.yaml --from jarvis --unit mm --size 640x480 --size cam1=320x240
check with-its-size says 1 'cam0                 640x480' 'cam1                 320x240' 'cam2                 640x480'
check a-size-of-no-camera needs 'no camera has this name' opencv.yml --unit m --size what=320x240 "${box[@]}"
check a-unit-that-is-not-the-files needs 'the files say that their unit is 1 m, and --unit says 0.001 m' camchain.yaml --unit mm "${box[@]}"
check a-wrong-unit-is-named needs 'or a unit of the files is not 0.001 m' opencv.yml --unit mm "${box[@]}"
check a-volume-elsewhere-is-named needs 'no camera sees the volume' opencv.yml --unit m --volume 9,9,9,9.5,9.5,9.5
check a-rig-is-no-calibration needs 'is a rig.yaml already' trip-rig.yaml --unit m "${box[@]}"
run "$pyrovox" calibrate import opencv.yml --unit m "${box[@]}" --out trip-rig.yaml
check nothing-is-overwritten says 1 'is there already; --force writes over it'
sed 's/^    t:/    gain: [2, 1, 1]\n&/' trip-rig.yaml > gains.yaml
run "$pyrovox" calibrate export --rig gains.yaml --to ros --out ros
check says-what-is-left-out says 0 'camera_info has no poses: they are left out' 'gains, photometry, blur and bodies are left out' 'ros: 4 cameras for ros'
run "$pyrovox" calibrate export --rig trip-rig.yaml --to jarvis --out no.jarvis
check a-lens-that-does-not-fit says 1 "jarvis cannot hold its lens"
not_structures() { # MATLAB's files of before 7.3, and objects, which only MATLAB can read
    printf 'MATLAB 5.0 MAT-file, Platform: GLNXA64' > old.mat
    "$py" -c 'import h5py; f = h5py.File("object.mat", "w"); f.create_group("#subsystem#"); f["stereoParams"] = [1.0]' || return 1
    "$py" -c 'import h5py; f = h5py.File("stereo.mat", "r+"); del f["s/RotationOfCamera2"]' || return 1
    needs 'stereo.mat: RotationOfCamera2 is missing: in MATLAB, ' stereo.mat "${box[@]}" || return 1
    needs "is not HDF5: in MATLAB, save it with '-v7.3'" old.mat "${box[@]}" && needs 'but an object, which only MATLAB can read: in MATLAB, s = toStruct(' object.mat "${box[@]}"
}
check matlab-objects not_structures
exit $rc
