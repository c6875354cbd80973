#!/bin/bash
# Live error bars side by side: 8 simulated GigE Vision cameras, 640x480 RGB, 64^3 voxels, with and without model.error_bars, in turns.
# Processor time of the daemon for each published set, latency, sets that were lost, sets that were solved once more.
#   live_bars.sh BUILD        LIVE_SECONDS=30 LIVE_FPS=20 LIVE_TURNS=2
set -u
cd "$(dirname "$0")/../.."
b=$(realpath "${1:-build}")
seconds=${LIVE_SECONDS:-30} fps=${LIVE_FPS:-20} turns=${LIVE_TURNS:-2}
dir=$(mktemp -d)
export PYROVOX_CACHE=$dir/cache
sim=
trap '[ -z "$sim" ] || kill "$sim" 2> /dev/null; rm -rf "$dir"' EXIT
"$b/bin/pyrovox" simcams --cameras 8 --size 640x480 --voxels 64 --ring 1 --write-rig "$dir/rig.yaml" --write-frames "$dir/frames" > "$dir/log" 2>&1 || { cat "$dir/log"; exit 1; }
look() { # processor seconds of the daemon and its status, as one line: cpu published lost p50 p99 solves left_out
    /usr/bin/python3 - "$b/bin/pyrovox" "ipc://$dir/control" "$dir/pyrovoxd.yaml" << 'END'
import glob, json, os, subprocess, sys
program, control, config = sys.argv[1:]
s = json.loads(subprocess.run([program, "status", "--endpoint", control, "--json"], capture_output=True, text=True, check=True).stdout)
for f in glob.glob("/proc/[0-9]*/cmdline"):
    try:
        argv = open(f).read().split("\0")
        if os.path.basename(argv[0]) == "pyrovoxd" and config in argv:
            t = open(f.replace("cmdline", "stat")).read().rsplit(")", 1)[1].split()
    except OSError:
        pass
e = s.get("error_bars", {"solves": 0, "left_out": []})
print((int(t[11]) + int(t[12])) / os.sysconf("SC_CLK_TCK"), s["sets"]["published"], s["sets"]["dropped"] + s["sets"]["displaced"],
      s["latency_ms"]["p50"], s["latency_ms"]["p99"], e["solves"], " ".join(f"{k['name']}={k['value']}" for k in e["left_out"]))
END
}
echo "| live, 8 x 640x480 RGB8, 64^3, $seconds s at $fps Hz | processor ms a set | published | lost | latency p50, p99 ms | solved once more | left out |"
echo "|---|---|---|---|---|---|---|"
for ((turn = 0; turn < turns; turn++)); do
    for bars in false true; do
        cat > "$dir/pyrovoxd.yaml" << END
rig: rig.yaml
cameras: "aravis:127.0.0.2+"
fps: $fps
pixel_format: RGB8
shared_clock: true
photometry: { black: 0.02 }
model: { error_bars: $bars }
publish: { endpoints: ["ipc://$dir/volumes"] }
control: { endpoint: "ipc://$dir/control" }
END
        "$b/bin/pyrovox" simcams --private-net --rig "$dir/rig.yaml" --fps "$fps" -- "$b/bin/pyrovoxd" --config "$dir/pyrovoxd.yaml" > "$dir/log" 2>&1 &
        sim=$!
        for ((n = 0; n < 1200; n++)); do
            p=$("$b/bin/pyrovox" status --endpoint "ipc://$dir/control" --json 2> /dev/null | grep -o '"published":[[:space:]]*[0-9]*' | grep -o '[0-9]*$')
            [ "${p:-0}" -ge 40 ] && break
            sleep 0.25
        done
        "$b/bin/pyrovox" ctl reset-latency --control "ipc://$dir/control" > /dev/null
        read -ra from <<< "$(look)"
        sleep "$seconds"
        read -ra to <<< "$(look)"
        "$b/bin/pyrovox" status --endpoint "ipc://$dir/control" --stop > /dev/null
        wait "$sim"; sim=
        awk -v bars=$bars -v a="${from[*]}" -v b="${to[*]}" 'BEGIN { split(a, f); n = split(b, t)
            printf "| error_bars: %s | %.1f | %d | %d | %.1f, %.1f | %d |", bars, 1e3 * (t[1] - f[1]) / (t[2] - f[2]), t[2] - f[2], t[3] - f[3], t[4], t[5], t[6] - f[6]
            for (i = 7; i <= n; i++) { split(f[i], u, "="); split(t[i], v, "="); if (v[2] > u[2]) printf " %s %d", v[1], v[2] - u[2] }
            print " |" }'
    done
done
