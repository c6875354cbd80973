#!/bin/bash
# offline: The paper's experiments on a recording: measured, stopped and gone on with, plausible, and a report that needs nothing.
name=094
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
experiment() { # more options...
    run "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16,24 --grid 24 "$@"
}
recording() {
    run "$pyrovox" simcams --cameras 5 --size 96x72 --ring 4 --voxels 24 --write-rig rig.yaml --write-frames take
    says 0 '4 frame sets in take'
}
stops() { # after some measurements, while others wait
    "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16,24 --grid 24 --out out > int.log 2>&1 &
    local pid=$!
    wait_for test -s out/state/done.csv
    kill -INT $pid; wait $pid; code=$?
    out=$(cat int.log)
    says 130 'are kept in out/state' || return 1
    cp out/state/done.csv before.csv
    [ ! -e out/report.html ] && [ "$(wc -l < before.csv)" -lt 59 ]
}
# As after a crash too: a line that was not finished is measured again, all others are not.
goes_on() {
    printf 'views:3:1,0.1,0.2' >> out/state/done.csv
    local kept; kept=$(wc -l < before.csv)
    experiment --out out; says 0 "59 measurements, $kept of them from an earlier run: out/report.html" || return 1
    ! grep -q 'count as flame' <<< "$out" || { echo "it warns: $out"; return 1; }
    head -n "$kept" out/state/done.csv | cmp - before.csv || return 1
    local now; now=$(cksum < out/state/done.csv)
    experiment --out out; says 0 '59 measurements, 59 of them' && [ "$now" = "$(cksum < out/state/done.csv)" ]
}
full_disk() { # what was measured before stays
    local before; before=$(cksum < out/state/done.csv)
    out=$( (trap '' XFSZ; ulimit -f 1; "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16,24 --grid 24 --out out) 2>&1); code=$?
    [ "$code" = 1 ] && [ "$before" = "$(cksum < out/state/done.csv)" ] && [ ! -e out/state/done.csv.tmp ] || { echo "exit $code: $out"; return 1; }
}
# The same numbers from any number of threads, however often it was stopped; times are others.
same_numbers() {
    experiment --out one --threads 1 --quiet; says 0 || return 1
    cmp <(cut -d, -f 1-8 out/fig5.csv) <(cut -d, -f 1-8 one/fig5.csv) && cmp <(cut -d, -f 1-10 out/fig6a.csv) <(cut -d, -f 1-10 one/fig6a.csv)
}
plausible() {
    "$py" - <<'PY'
import csv
def table(name):
    return list(csv.DictReader(open("out/" + name)))
def mean(row, what="inside"):
    return sum(float(row[f"{what}_{c}"]) for c in ("red", "green", "blue")) / 3
by_frame, grids, views, solvers = map(table, ("fig5.csv", "fig6b.csv", "fig6a.csv", "solvers.csv"))
assert len(by_frame) == 8 and [g["grid"] for g in grids] == ["16", "24"] and [v["views"] for v in views] == ["3", "4"]
assert [int(v["choices"]) for v in views] == [10, 5] and all(int(g["frames"]) == 4 for g in grids)
for r in by_frame + grids + views + solvers: # there is noise, and a flame is brighter than the error
    assert 0.1 < mean(r) < 25 and float(r["ms"]) > 0, r
    assert abs(mean(r, "all") / mean(r) - 1) < 0.2, r
for g in (16, 24): # a mean is that of the frames
    rows = [mean(r) for r in by_frame if r["grid"] == str(g)]
    assert abs(sum(rows) / 4 - mean(grids[g == 24])) < 1e-4
assert mean(grids[1]) < 1.2 * mean(grids[0]), "a finer grid is worse"
assert mean(views[1]) < mean(views[0]), "more views are worse"
own = {(s["solver"], s["basis"], s["grid"]): mean(s) for s in solvers}
for g in ("16", "24"):
    assert own["pcg", "box", g] < own["cgls-paper", "box", g]
assert len(own) == len(solvers) == 32, len(own)
figure = {r[0]: list(map(float, r[1:])) for r in csv.reader(open("out/state/done.csv")) if r[0].startswith("figure")}
assert figure["figure:3"][0] < 0.5 * figure["figure:3"][2], "the hull leaves the ghosts"
assert sum(figure["figure:4"][:3]) == 24 ** 3 and figure["figure:4"][2] > figure["figure:4"][0] > 0
assert figure["figure:7"][6] > 0.9, "the unused view is not like its picture"
PY
}
report() { # well-formed, whole, and asks nobody for anything
    "$py" - <<'PY' || return 1
import base64, re, xml.etree.ElementTree as tree
text = open("out/report.html", encoding="utf-8").read()
root = tree.fromstring(text.split("\n", 1)[1])
html = "{http://www.w3.org/1999/xhtml}"
images = [i.get("src") for i in root.iter(html + "img")]
assert len(images) == 6 and all(i.startswith("data:image/png;base64,") for i in images), len(images)
for name, i in zip(("fig3-without", "fig3", "fig4", "fig7", "fig8", "fig8-other"), images):
    assert base64.b64decode(i[22:], validate=True) == open(f"out/{name}.png", "rb").read(), name
assert len(list(root.iter("{http://www.w3.org/2000/svg}svg"))) == 5
rest = re.sub(r"data:image/png;base64,[^\"]*", "", text)
assert not re.search(r"(?:src|href)=|url\(|<script|<link|@import", rest.replace('src=""', "")), "it asks for something"
assert not re.search(r"\b-?(nan|inf)\b", rest), "no number"
assert rest.count("holds here") >= 8, rest.count("holds here")
PY
    [ "$(head -c 4 out/report.pdf)" = %PDF ] && [ ! -e out/report.pdf.tmp ]
}
no_weasyprint() { # the page is there all the same
    out=$(PATH=$dir/nothing "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16,24 --grid 24 --out out 2>&1); code=$?
    says 0 'apt install weasyprint' && [ -s out/report.html ] && [ ! -e out/report.pdf ]
}
others() { # what is there is not mixed with something else
    run "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16 --grid 24 --out out
    says 1 'other arguments or on another recording' '--anew' && [ "$(wc -l < out/state/done.csv)" = 59 ] || return 1
    touch -d '2001-01-01' take/cam?/*.png
    experiment --out out; says 1 'another recording' || return 1
    run "$pyrovox" experiment take --rig rig.yaml --black 0.02 --grids 16 --grid 16 --frames-max 2 --unused cam3 --grey --out out --anew --quiet
    says 0 && grep -q 'camera <b>cam3' out/report.html && [ "$(wc -l < out/fig5.csv)" = 3 ] && grep -q ^views,inside_grey out/fig6a.csv
}
bad_input() {
    experiment --out x --cameras cam0,cam1,cam2; says 1 '3 cameras are too few' 'four' || return 1
    experiment --out x --threshold 0.99; says 1 'no flame in any of 4 frame sets' '--threshold' || return 1
    experiment --out x --unused cam9; says 1 'no such camera' 'cam0' || return 1
    run "$pyrovox" experiment nowhere --rig rig.yaml --out y; says 1 'nowhere: no frames' 'No such' && [ ! -e y ] || return 1
    run "$pyrovox" experiment take --out y; says 2 'needs FRAMES, --rig and --out' || return 1
    experiment --out y --grids 16,x; says 2 'grids' || return 1
    experiment --out y --grids 24,16,24; says 2 '24 is there twice' || return 1
    run "$pyrovox" experiment take --rig rig.yaml --out rig.yaml/below; says 1 'rig.yaml' || return 1
    cp -r take gaps && rm gaps/cam2/*.png
    run "$pyrovox" experiment gaps --rig rig.yaml --out y; says 1 'lacks a camera' '--cameras' || return 1
    head -c 100 take/cam1/000001.png > gaps/cut && cp -f take/cam2/*.png gaps/cam2/ && mv gaps/cut gaps/cam1/000001.png
    run "$pyrovox" experiment gaps --rig rig.yaml --black 0.02 --grids 16 --grid 16 --out y; says 1 '000001' 'cannot be used'
}
for t in recording stops goes_on full_disk same_numbers plausible report no_weasyprint others bad_input; do check $t $t; done
exit $rc
