#!/bin/bash
# Darks belong to a camera at a temperature: what the cameras say of themselves, by the real GigE Vision protocol, comes
# into takes and from there into the rig; another camera's pictures, or those of a warmer one, are told from them,
# offline and live.
name=057
. "$(dirname "$0")/lib.sh"
sim() { timeout "$patience" "$pyrovox" simcams --private-net --cameras 4 --size 80x60 --voxels 24 --fps 20 --ring 20 "$@"; }
if ! sim --write-rig "$dir/rig.yaml" -- true > "$dir/try.txt" 2>&1; then
    echo "no private network here: $(grep pyrovox "$dir/try.txt" | tail -n 1)"; exit 77
fi
{ echo "publish: {endpoints: [\"$volumes\"], sample: f32}"
  echo "control: {endpoint: \"$control\"}"
  echo $'cameras: "aravis:127.0.0.2+"\nfps: 20\npixel_format: Mono8\nshared_clock: true'
} > "$dir/rest.yaml"
daemon() { # rig, log, more keys, options of the cameras...
    local rig=$1 log=$2
    { echo "rig: $dir/$1"; cat "$dir/rest.yaml"; echo "$3"; } > "$dir/run.yaml"
    shift 3
    start "$log" "$pyrovox" simcams --private-net --rig "$dir/$rig" --fps 20 --ring 20 "$@" -- "$pyrovoxd" --config "$dir/run.yaml"
}
stop() { "$pyrovox" status --endpoint "$control" --stop > "$dir/null"; ended "$started" 0; }

daemon rig.yaml record.log "record: {mode: raw, path: \"$dir/take.h5\"}" --set "cap all on"
warm() { field "s['record']['sets'] >= $1 and all(c['health'].get('temperature_c') for c in s['cameras'])"; }
check recorded wait_for warm 16
check serials field "[c['health']['serial'] for c in s['cameras']] == ['SIM00', 'SIM01', 'SIM02', 'SIM03']"
n=$(status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["record"]["sets"])')
check then_more wait_for warm $((n + 5)) # sets that know the temperature
check stopped stop
told() { run "$pyrovox" replay --info "$dir/take.h5"; says 0 'serial SIM01, 4' && grep -qE 'serial SIM03, [0-9.]+ C' <<< "$out"; }
check take_tells told

dark() { run "$pyrovox" calibrate dark --rig "$dir/rig.yaml" --frames "$dir/take.h5" --out "$dir/dark.yaml"; says 0 'cam3'; }
check dark dark
in_rig() { [ "$(grep -cE "^      $1" "$dir/dark.yaml")" = 4 ] || { grep -A9 photometry "$dir/dark.yaml"; false; }; }
check whose in_rig 'device: "SIM0[0-3]"'
check how_warm in_rig 'temperature: 4[0-9]'
sed 's/temperature: .*/temperature: 20/' "$dir/dark.yaml" > "$dir/cold.yaml"
sed 's/device: "SIM00"/device: "SIM09"/' "$dir/dark.yaml" > "$dir/other.yaml"
sed '/temperature:/d' "$dir/dark.yaml" > "$dir/old.yaml"
sed 's/device: "SIM00"/device: "SIM09"/' "$dir/cold.yaml" > "$dir/both.yaml"

offline() { # rig, code, text...
    run "$pyrovox" reconstruct --quiet --rig "$dir/$1" --frames "$dir/take.h5" --last 1000 --out "$dir/v-$1"
    shift
    says "$@"
}
check right_darks offline dark.yaml 0
check too_cold offline cold.yaml 1 'camera cam0 had 4' 'degrees Celsius, but its dark is of 20.0'
check another offline other.yaml 1 "camera cam0 is SIM00, but the rig's photometry was measured on SIM09"
check not_known offline old.yaml 0 "the temperature of 4 cameras' darks is not checked"

daemon both.yaml both.log "sync: {policy: partial}"
said() { grep -q "$1" "$dir/both.log"; }
check left_out wait_for said "cam0 is SIM00, but the rig's photometry was measured on SIM09: it is left out"
check runs wait_for field "s['last']['cameras'] == 3"
check warmer wait_for said "cam2 has 4.* degrees Celsius, but its dark is of 20.0"
check nobody_else field "all(c['counts']['lost_camera'] == 0 for c in s['cameras'])"
check ends stop
exit $rc
