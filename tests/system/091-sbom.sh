#!/bin/bash
# What `make sbom` writes: SPDX 2.3 with all that it must have, about these files, and complete.
name=091
. "$(dirname "$0")/lib.sh"
systemd/install.sh "$b" "$dir/root" /usr || { echo "FAIL $name:install"; exit 1; }
sbom() { SOURCE_DATE_EPOCH=1800000000 "$py" systemd/sbom.py "$dir/root" 9.8.7 "$1"; }
sbom "$dir/a.json" > "$dir/said" || { echo "FAIL $name:written"; exit 1; }
of() { "$py" - "$dir/a.json" "$dir/root" "$@"; }

must_have() {
    of << 'PY'
import json, re, sys
doc = json.load(open(sys.argv[1]))
assert (doc["spdxVersion"], doc["dataLicense"], doc["SPDXID"]) == ("SPDX-2.3", "CC0-1.0", "SPDXRef-DOCUMENT")
assert doc["name"] == "pyrovox-9.8.7" and re.fullmatch(r"[a-z]+:[^#\s]+", doc["documentNamespace"])
assert doc["creationInfo"]["created"] == "2027-01-15T08:00:00Z"
assert all(re.match(r"(Tool|Person|Organization): \S", c) for c in doc["creationInfo"]["creators"]) and doc["creationInfo"]["creators"]
elements = [doc] + doc["packages"] + doc["files"]
ids = [e["SPDXID"] for e in elements]
assert len(set(ids)) == len(ids) and all(re.fullmatch(r"SPDXRef-[A-Za-z0-9.-]+", i) for i in ids)
for p in doc["packages"]:
    assert p["name"] and p["versionInfo"] and p["downloadLocation"] and p["licenseDeclared"], p
    assert ("packageVerificationCode" in p) == p["filesAnalyzed"], p
for f in doc["files"]:
    assert f["fileName"].startswith("./") and {"SHA1", "SHA256"} == {c["algorithm"] for c in f["checksums"]}, f
for r in doc["relationships"]:
    assert r["spdxElementId"] in ids and r["relatedSpdxElement"] in ids and re.fullmatch("[A-Z_]+", r["relationshipType"]), r
assert [r["relatedSpdxElement"] for r in doc["relationships"] if r["relationshipType"] == "DESCRIBES"] == ["SPDXRef-Package-pyrovox"]
has = {x["licenseId"] for x in doc["hasExtractedLicensingInfos"] if x["extractedText"]}
named = set(re.findall(r"LicenseRef-[A-Za-z0-9.-]+", " ".join(p["licenseDeclared"] for p in doc["packages"])))
assert named == has, named ^ has
PY
}
check must_have must_have

licences() { # as SPDX's own list has them
    of << 'PY' | NODE_PATH=/usr/share/nodejs node -e '
        const parse = require("spdx-expression-parse"), known = require("spdx-license-ids")
        const all = require("fs").readFileSync(0, "utf8").split("\n").filter(Boolean)
        const bad = all.filter(e => { try { parse(e); return false } catch (_) { return true } })
        const names = all.flatMap(e => e.split(/ AND | OR /)).filter(n => !/^LicenseRef-/.test(n) && !known.includes(n))
        console.log(all.length, "expressions", bad, names); process.exit(all.length > 20 && !bad.length && !names.length ? 0 : 1)' > "$dir/licences" ||
import json, sys
print("\n".join(sorted({p["licenseDeclared"] for p in json.load(open(sys.argv[1]))["packages"]} - {"NOASSERTION"})))
PY
        { cat "$dir/licences"; return 1; }
}
check licences licences

complete() { # every file; all that the loader itself takes for it, of these versions; and no GPL where README says none
    of << 'PY'
import hashlib, json, os, re, subprocess, sys
doc, root = json.load(open(sys.argv[1])), sys.argv[2]
files = {f["fileName"]: f for f in doc["files"]}
elf = {"./" + os.path.relpath(p, root) for d, _, names in os.walk(root) for n in names
       if not os.path.islink(p := os.path.join(d, n)) and open(p, "rb").read(4) == b"\x7fELF"}
assert elf == set(files) and "./usr/bin/pyrovoxd" in elf and len(elf) >= 7, elf ^ set(files)
version = {p["name"]: p["versionInfo"] for p in doc["packages"]}
uses = {}
for r in doc["relationships"]:
    if r["relationshipType"] in ("DYNAMIC_LINK", "STATIC_LINK", "DEPENDS_ON"):
        uses.setdefault(r["spdxElementId"], []).append(r["relatedSpdxElement"])
name_of = {p["SPDXID"]: p["name"] for p in doc["packages"]}
def said(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
loaded = {f: re.findall(r"=> (/\S+)", said("ldd", os.path.join(root, f))) for f in files}
names = {} # dpkg knows a file by one of these
for lib in {x for libs in loaded.values() for x in libs}:
    for n in (lib, os.path.realpath(lib)):
        names.update({n: lib, re.sub("^/usr", "", n): lib, "/usr" + re.sub("^/usr", "", n): lib})
owner = {names[n]: p.split(",")[0].split(":")[0] for p, n in (line.rsplit(": ", 1) for line in said("dpkg", "-S", *names).splitlines())}
installed = dict(x.split("\t") for x in said("dpkg-query", "-W", "-f=${Package}\t${Version}\n", *set(owner.values())).splitlines())
gpl = {"libx264-164", "libx265-199", "libcholmod3", "libspqr2", "libavcodec59", "libjbig0"}
for f in files.values():
    path = os.path.join(root, f["fileName"])
    got = {c["algorithm"]: c["checksumValue"] for c in f["checksums"]}
    assert got["SHA256"] == hashlib.sha256(open(path, "rb").read()).hexdigest(), path
    have, todo = set(), [f["SPDXID"]]
    while todo:
        if (x := todo.pop()) not in have:
            have.add(x)
            todo += uses.get(x, [])
    have = {name_of[x] for x in have if x in name_of}
    assert loaded[f["fileName"]], path
    for lib in loaded[f["fileName"]]:
        assert owner[lib] in have and version[owner[lib]] == installed[owner[lib]], (path, lib, owner[lib])
    may = f["fileName"].endswith(("/pyrovox-films.so", "/pyrovox-tiff.so", "/pyrovox-calib.so"))
    assert bool(have & gpl) == may, (path, have & gpl)
PY
}
check complete complete

again() { sbom "$dir/b.json" > /dev/null && cmp "$dir/a.json" "$dir/b.json"; }
check same_again again

tarball() { # unpacked in somebody's repository: the date is that of NEWS
    local theirs=$dir/theirs
    mkdir -p "$theirs/tree" && git -C "$theirs" init -q && git -C "$theirs" -c user.name=they -c user.email=they@example.org commit -q --allow-empty -m theirs &&
        touch -d @1700000000 "$theirs/tree/NEWS" &&
        (sbom=$PWD/systemd/sbom.py && cd "$theirs/tree" && env -u SOURCE_DATE_EPOCH "$py" "$sbom" "$dir/root" 9.8.7 "$dir/c.json" > /dev/null) &&
        grep -q '"created": "2023-11-14T22:13:20Z"' "$dir/c.json"
}
check date_of_a_tarball tarball
exit $rc
