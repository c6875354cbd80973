#!/bin/bash
# value and report: Figures of a recording as a lab reads them: text, table, plot, and the page of `pyrovox report`; what cannot be
# measured or belongs to another recording, with its sentence.
name=110
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
"$b/tests/unit/test_pub" --publish "$volumes" 12 0 & pub=$!; pids+=("$pub")
timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --out flame > record.log 2>&1; wait "$pub"
"$pyrovox" convert flame flame.h5 > /dev/null 2>&1

# The figures are numpy's.
figures() {
    run "$pyrovox" value flame --quiet --csv all.csv --above 0.5; says 0 'set ' 'light m2' 'has no error bars' '--error-bars' || return 1
    run "$pyrovox" value flame.h5 --quiet --csv part.csv --above 0.5 --box=-0.2,-0.2,0.1,0.3,0.1,0.5 --channel red --from 2 --to 5; says 0 || return 1
    run "$pyrovox" value flame.h5 --quiet --csv auto.csv; says 0 'volume is that above' || return 1
    "$py" -c 'import numpy' || { echo "SKIP $name:figures (apt-get install python3-numpy)"; return 0; }
    "$py" - << 'END'
import csv, glob, json, numpy as np
sets = []
for n in sorted(glob.glob("flame/0*.npy")):
    j, a = json.load(open(n[:-3] + "json")), np.load(n).astype(float)
    sets.append((j, a.reshape(a.shape[:3] + (-1,))))
def rows(name):
    return {int(r["set"]): r for r in csv.DictReader(open(name))}
def centres(j, a):
    return [np.array(j["origin"][k]) + (np.arange(a.shape[2 - k]) + 0.5) * j["spacing"][k] for k in range(3)]
every, part, auto = rows("all.csv"), rows("part.csv"), rows("auto.csv")
assert len(every) == len(sets) == 12 and sorted(part) == [j["set"] for j, a in sets if 2 <= j["set"] <= 5]
top = max(a.mean(3).max() for j, a in sets)
for j, a in sets:
    V, v = np.prod(j["spacing"]), a.mean(3)
    r = every[j["set"]]
    assert np.isclose(float(r["mean_per_m"]), v.mean(), rtol=1e-5), (r, v.mean())
    assert np.isclose(float(r["light_m2"]), v.sum() * V, rtol=1e-5) and r["light_sd"] == "" and r["doubt"] == ""
    assert np.isclose(float(r["volume_m3"]), (v > 0.5).sum() * V) and np.isclose(float(r["most_per_m"]), v.max(), rtol=1e-5)
    layers = v.sum((1, 2)).cumsum() / v.sum()
    z = j["origin"][2] + np.interp(0.98, np.r_[0, layers], np.arange(len(layers) + 1)) * j["spacing"][2]
    assert abs(float(r["height_m"]) - z) < 1e-6, (r["height_m"], z)
    assert np.isclose(float(auto[j["set"]]["volume_m3"]), (v > 0.1 * top).sum() * V)
    if j["set"] in part:
        x, y, z = centres(j, a)
        s = a[np.ix_((z >= 0.1) & (z <= 0.5), (y >= -0.2) & (y <= 0.1), (x >= -0.2) & (x <= 0.3))][..., 0]
        assert s.size and np.isclose(float(part[j["set"]]["mean_per_m"]), s.mean(), rtol=1e-5)
END
}
plots() {
    run "$pyrovox" value flame.h5 --quiet --plot flame.svg --csv flame.csv; says 0 || return 1
    [ "$(grep -o '<polyline' flame.svg | wc -l)" = 5 ] && "$py" -c 'import xml.dom.minidom as m; m.parse("flame.svg")' || return 1
    sha256sum flame.svg flame.csv > before
    run "$pyrovox" value flame.h5 --quiet --plot flame.svg; says 1 'flame.svg is there already' '--force' || return 1
    run "$pyrovox" value flame.h5 --quiet --csv flame.csv --plot new.svg; says 1 'flame.csv is there already' && [ ! -e new.svg ] || return 1
    sha256sum --quiet -c before && run "$pyrovox" value flame.h5 --quiet --csv flame.csv --from 3 --force && says 0 && ! sha256sum --quiet -c before 2> /dev/null
}
refused() {
    run "$pyrovox" value flame.h5 --box 9,9,9,10,10,10; says 1 'no voxel has its centre in the region' 'the volume goes from' || return 1
    run "$pyrovox" value flame.h5 --from 99999; says 1 'none of its 12 sets' || return 1
    run "$pyrovox" value flame.h5 --channel blue --quiet; says 0 "set " || return 1
    run "$pyrovox" value flame.h5 --box 1,2,3; says 2 'should be 6 numbers' || return 1
    run "$pyrovox" value flame.h5 --slice 0.1; says 2 'z=0.1' || return 1
    run "$pyrovox" value flame.h5 --slice z=0.1 --sphere 0,0,0,1; says 2 'one region' || return 1
    run "$pyrovox" value; says 2 'which recording' || return 1
    run "$pyrovox" value record.log; says 1 'record.log' || return 1
    head -c 3000 flame.h5 > cut.h5
    run "$pyrovox" value cut.h5; says 1 'cut.h5'
}
# The page has what the recording and its pictures say; a well-formed page, and nothing is written over.
page() {
    "$pyrovox" simcams --cameras 5 --size 96x72 --ring 8 --voxels 24 --write-rig rig.yaml --write-frames take > /dev/null 2>&1
    "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out solved.h5 --quiet 2> /dev/null || return 1
    run "$pyrovox" report solved.h5 --rig rig.yaml --frames take --black 0.02 --sets 5 --quiet --out page; says 0 || return 1
    "$py" - << 'END' || return 1
import csv, struct, xml.dom.minidom
page = xml.dom.minidom.parse("page/report.html")
text = open("page/report.html").read()
assert [h.firstChild.data for h in page.getElementsByTagName("h2")] == [
    "Setup", "Cameras and calibration", "Rates and losses", "One volume", "Course", "Left-out views", "Advice",
    "Versions and options", "How it was reconstructed", "rig.yaml, as it was in effect"], text
assert len(page.getElementsByTagName("img")) == 3 and len(page.getElementsByTagName("svg")) == 4
rows = list(csv.DictReader(open("page/sets.csv")))
assert len(rows) == 8 and "8, numbers 0 to 7" in text and "24 x 24 x 24" in text
brightest = max(rows, key=lambda r: float(r["light_m2"]))["set"]
assert f"Set {brightest}, three slices" in text
views = [r for t in page.getElementsByTagName("table") if "noise alone" in t.toxml() for r in t.getElementsByTagName("tr")[1:]]
errors = [float(r.getElementsByTagName("td")[1].firstChild.data) for r in views]
assert len(errors) == 5 and all(0 < e < 60 for e in errors), errors
for a in "xyz":
    png = open(f"page/slice-{a}.png", "rb").read()
    w, h = struct.unpack(">II", png[16:24])
    assert (w, h) == (360, 360), (w, h)
END
    ! command -v weasyprint > /dev/null || [ "$(head -c 5 page/report.pdf)" = %PDF- ] || return 1
    sha256sum page/* > before
    run "$pyrovox" report solved.h5 --rig rig.yaml --out page; says 1 'page/report.html is there already' && sha256sum --quiet -c before || return 1
    mkdir kept && echo mine > kept/sets.csv
    run "$pyrovox" report solved.h5 --rig rig.yaml --out kept; says 1 'kept/sets.csv is there already' && [ "$(cat kept/sets.csv)" = mine ] && [ ! -e kept/report.html ] || return 1
    run "$pyrovox" report solved.h5 --rig rig.yaml --out plain --set 3 --quiet; says 0 && grep -q 'Set 3, three' plain/report.html && grep -q 'give --frames' plain/report.html
}
# Another rig, another recording, and one that made no depth.
page_refused() {
    sed -E '0,/K: \[/s/K: \[/K: [1/' rig.yaml > other.yaml
    run "$pyrovox" report solved.h5 --rig other.yaml --out no; says 1 'was made with another rig than other.yaml' || return 1
    run "$pyrovox" report solved.h5 --rig rig.yaml --cameras cam0,cam1 --out no; says 1 'another rig' || return 1
    mkdir late
    for c in 0 1 2 3 4; do
        mkdir late/cam$c
        for i in 0 1 2; do cp take/cam$c/00000$i.png late/cam$c/00090$i.png; done
    done
    run "$pyrovox" report solved.h5 --rig rig.yaml --frames late --black 0.02 --out no2 --quiet; says 1 'late: none of its sets is in solved.h5' || return 1
    run "$pyrovox" report solved.h5 --rig rig.yaml --out no2 --set 99 --quiet; says 1 '--set 99: solved.h5 has no volume of it' || return 1
    run "$pyrovox" report rig.yaml --rig rig.yaml --out no; says 1 'rig.yaml' || return 1
    run "$pyrovox" report solved.h5 --rig rig.yaml; says 2 'needs a recording and --out' && [ ! -e no ] && [ ! -e no2/report.html ]
}
check figures_are_numpy_s figures
check plots_and_tables plots
check refused_by_name refused
check the_page page
check the_page_is_refused page_refused
