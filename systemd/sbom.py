#!/usr/bin/python3
"""What the programs, libraries and modules of a build are linked with, and under which licences: SPDX 2.3.

    sbom.py ROOT VERSION OUT.json       (ROOT: what `make install PREFIX=/usr DESTDIR=ROOT` put there)

Each library is looked up where the loader of this machine finds it, and its Debian package asked for version and licence;
then what that is linked with, to the last.  SOURCE_DATE_EPOCH is the date, else that of the last commit, or of NEWS in a
tarball.  Prints what each file needs by itself."""
import datetime
import glob
import hashlib
import json
import os
import re
import subprocess
import sys
import uuid

# Headers that the modules include are in them, beside what they are linked with.
SOURCES = {"pyrovox-tiff.so": "capture/files/tiff.c", "pyrovox-films.so": "capture/files/film_*.c", "pyrovox-aruco.so": "recon/board/*_shim.cpp",
           "pyrovox-calib.so": "recon/calib/shim.cpp", "pyrovox-libcamera.so": "capture/libcamera/shim.cpp",
           "pyrovox-openvdb.so": "daemon/volumes/*.cpp"}
# Debian's names of licences -> SPDX's, where they are the same text.
NAMES = {"expat": "MIT", "mit": "MIT", "isc": "ISC", "zlib": "Zlib", "curl": "curl", "ftl": "FTL", "postgresql": "PostgreSQL",
         "apache-2.0": "Apache-2.0", "bsl-1.0": "BSL-1.0", "cc0-1.0": "CC0-1.0", "mpl-1.1": "MPL-1.1", "mpl-2.0": "MPL-2.0",
         "bsd-2-clause": "BSD-2-Clause", "bsd-3-clause": "BSD-3-Clause", "bsd-4-clause": "BSD-4-Clause",
         "openldap-2.8": "OLDAP-2.8", "artistic": "Artistic-1.0-Perl"}


def run(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False).stdout


def is_elf(path):
    with open(path, "rb") as f:
        return f.read(4) == b"\x7fELF"


def needed(paths):
    """path -> the names of what it is linked with."""
    out, at = {p: [] for p in paths}, paths[0] if paths else None
    for line in run("readelf", "-dW", *paths).splitlines():
        if line.startswith("File: "):
            at = line[6:]
        elif m := re.search(r"\(NEEDED\).*\[(.*)\]", line):
            out[at].append(m[1])
    return out


def loader():
    """name -> path, of this machine's own kind of processor."""
    kind = {"x86_64": "x86-64", "aarch64": "AArch64"}.get(os.uname().machine, "libc6")
    found = {}
    for m in re.finditer(r"^\s+(\S+) \(([^)]*)\) => (\S+)$", run("/sbin/ldconfig", "-p"), re.M):
        if kind in m[2]:
            found.setdefault(m[1], m[3])
    return found


def packages(paths):
    """path -> (package, version).  Files of /lib and /usr/lib are the same; dpkg knows one of the names."""
    names = {}
    for p in paths:
        real = os.path.realpath(p)
        for name in {p, real, re.sub(r"^/usr/lib", "/lib", real), re.sub(r"^/usr/lib", "/lib", p)}:
            names.setdefault(name, set()).add(p)
    owner = {}
    for line in run("dpkg", "-S", *sorted(names)).splitlines():
        package, _, name = line.partition(": ")
        for p in names.get(name, ()):
            owner[p] = package.split(",")[0].split(":")[0]
    rows = (row.split("\t") for row in run("dpkg-query", "-W", "-f=${Package}\t${Version}\t${db:Status-Abbrev}\n",
                                           *sorted(set(owner.values()))).splitlines())
    version = {name: v for name, v, status in rows if status.startswith("ii")}
    return {p: (package, version[package]) for p, package in owner.items()}


def expression(words, refs):
    """Debian's short name of a licence as an SPDX expression; what SPDX has no name for becomes a LicenseRef."""
    def one(name):
        if m := re.fullmatch(r"(L?GPL|AGPL)-?v?([123])(?:\.([01]))?(\+?)", name, re.I):
            return f"{m[1].upper()}-{m[2]}.{m[3] or 0}-{'or-later' if m[4] else 'only'}"
        if name.lower() in NAMES:
            return NAMES[name.lower()]
        ref = "LicenseRef-Debian-" + re.sub(r"[^A-Za-z0-9.]+", "-", name.replace("+", "-or-later")).strip("-")
        refs[ref] = name
        return ref
    words = " ".join(words.split())
    if not words:
        return "NOASSERTION"
    if "," in words or " with " in words:
        return one(words)
    parts = re.split(r" (and|or) ", words, flags=re.I)
    return " ".join(p.upper() if i % 2 else one(p) for i, p in enumerate(parts))


def licence(package, refs):
    """(the licence of most of the package's source, all that its copyright file names) as Debian says."""
    path = f"/usr/share/doc/{package}/copyright"
    try:
        with open(path, encoding="utf-8", errors="replace") as f:
            text = f.read()
    except OSError:
        return "NOASSERTION", []
    first, names = "", set()
    for paragraph in re.split(r"\n\s*\n", text):
        field = {m[1].lower(): m[2] for m in re.finditer(r"^([A-Za-z-]+):[ \t]*(.*(?:\n[ \t].*)*)", paragraph, re.M)}
        name = field.get("license", "").split("\n")[0].strip()
        if name and text.startswith("Format:"):
            names.add(name)
            if not first and "*" in field.get("files", "").split():
                first = name
    if not names: # not to be read by programs: the texts that it points to
        names = {n.rstrip(".") for n in re.findall(r"common-licenses/([A-Za-z0-9.-]+)", text)}
    return (expression(first, refs) if first else "NOASSERTION"), sorted(names)


def digest(path, kind):
    with open(path, "rb") as f:
        return hashlib.new(kind, f.read()).hexdigest()


def headers_of(name):
    """The packages of the headers that a module's source includes."""
    paths = set()
    for source in glob.glob(SOURCES.get(name, "")):
        with open(source, encoding="utf-8") as f:
            for header in re.findall(r"#include <([\w./+-]+/[\w./+-]+)>", f.read()):
                paths.update(p for d in ("", "opencv4/", "libcamera/", "*-linux-gnu/")
                             for p in glob.glob(f"/usr/include/{d}{header}"))
    return {package for package in packages(paths).values() if not package[0].startswith(("libc6", "linux-"))}


def main(root, version, out):
    shipped = sorted(p for p in glob.glob(root + "/**", recursive=True)
                     if os.path.isfile(p) and not os.path.islink(p) and is_elf(p))
    if not shipped:
        sys.exit(f"{root}: no program in it; make install DESTDIR={root} PREFIX=/usr")
    where, links, todo = loader(), needed(shipped), []
    own = {os.path.basename(p) for p in shipped}
    while True: # until everything that is linked with has been read
        names = {n for names in links.values() for n in names}
        todo = sorted({where[n] for n in names if n in where} - set(links))
        if not todo:
            break
        links.update(needed(todo))
    missing = sorted({n for names in links.values() for n in names} - set(where) - own)
    if missing:
        sys.exit("not found by this machine's loader: " + " ".join(missing))
    package = packages(set(links) - set(shipped))
    unowned = sorted(set(links) - set(shipped) - set(package))
    if unowned:
        sys.exit("of no Debian package: " + " ".join(unowned))

    def direct(path):
        return {package[where[n]] for n in links[path] if n in where}

    inside = {p: headers_of(os.path.basename(p)) for p in shipped}
    uses = {} # package -> packages
    for p, mine in package.items():
        uses.setdefault(mine, set()).update(direct(p) - {mine})
    for headers in inside.values():
        for h in headers:
            uses.setdefault(h, set())

    refs, shown = {}, {}
    doc = {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"pyrovox-{version}"}
    ident = lambda kind, name: f"SPDXRef-{kind}-" + re.sub(r"[^A-Za-z0-9.]+", "-", name.replace("+", "plus")).strip("-")
    files, relations = [], [("SPDXRef-DOCUMENT", "DESCRIBES", "SPDXRef-Package-pyrovox")]
    for p in shipped:
        name = os.path.relpath(p, root)
        files.append({"fileName": "./" + name, "SPDXID": ident("File", name), "fileTypes": ["BINARY"],
                      "checksums": [{"algorithm": a, "checksumValue": digest(p, a.lower())} for a in ("SHA1", "SHA256")],
                      "licenseConcluded": "NOASSERTION", "licenseInfoInFiles": ["Apache-2.0"],
                      "copyrightText": "2026 The Pyrovox maintainers"})
        relations.append(("SPDXRef-Package-pyrovox", "CONTAINS", files[-1]["SPDXID"]))
        relations += [(files[-1]["SPDXID"], "DYNAMIC_LINK", ident("Package", x[0])) for x in sorted(direct(p))]
        relations += [(files[-1]["SPDXID"], "STATIC_LINK", ident("Package", x[0])) for x in sorted(inside[p])]
        relations += [(files[-1]["SPDXID"], "DYNAMIC_LINK", ident("File", os.path.relpath(q, root)))
                      for q in shipped if os.path.basename(q) in links[p] and q != p]
    code = hashlib.sha1("".join(sorted(f["checksums"][0]["checksumValue"] for f in files)).encode()).hexdigest()
    doc["packages"] = [{"name": "pyrovox", "SPDXID": "SPDXRef-Package-pyrovox", "versionInfo": version,
                        "downloadLocation": "NOASSERTION", "filesAnalyzed": True,
                        "packageVerificationCode": {"packageVerificationCodeValue": code},
                        "licenseConcluded": "NOASSERTION", "licenseDeclared": "Apache-2.0",
                        "licenseInfoFromFiles": ["Apache-2.0"], "copyrightText": "2026 The Pyrovox maintainers"}]
    for x in sorted(uses):
        declared, names = licence(x[0], refs)
        shown[x] = declared if declared != "NOASSERTION" else "?  " + "; ".join(names)
        said = "; ".join(names) or "no licence by a name"
        doc["packages"].append({
            "name": x[0], "SPDXID": ident("Package", x[0]), "versionInfo": x[1], "supplier": "Organization: Debian",
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "licenseConcluded": "NOASSERTION",
            "licenseDeclared": declared, "copyrightText": "NOASSERTION",
            "licenseComments": f"Of the whole source; /usr/share/doc/{x[0]}/copyright names: {said}",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                              "referenceLocator": f"pkg:deb/debian/{x[0].replace('+', '%2B')}@{x[1].replace('+', '%2B')}"}]})
        relations += [(ident("Package", x[0]), "DEPENDS_ON", ident("Package", y[0])) for y in sorted(uses[x])]
    date = int(os.environ.get("SOURCE_DATE_EPOCH") or (os.path.exists(".git") and run("git", "log", "-1", "--format=%ct")) or os.stat("NEWS").st_mtime)
    doc["creationInfo"] = {"created": datetime.datetime.fromtimestamp(date, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
                           "creators": [f"Tool: pyrovox-sbom-{version}"]}
    doc["files"] = files
    doc["relationships"] = [dict(zip(("spdxElementId", "relationshipType", "relatedSpdxElement"), r)) for r in relations]
    doc["hasExtractedLicensingInfos"] = [
        {"licenseId": ref, "name": name, "extractedText": f'"{name}", as the copyright files of Debian\'s packages name it and have it'}
        for ref, name in sorted(refs.items())]
    doc["documentNamespace"] = "urn:uuid:" + str(uuid.uuid5(uuid.NAMESPACE_OID, json.dumps(doc, sort_keys=True)))
    with open(out, "w", encoding="utf-8") as f:
        json.dump(doc, f, indent=1)
        f.write("\n")

    print(f"{out}: {len(files)} files, {len(uses)} packages")
    for p in shipped:
        print(f"\n{os.path.relpath(p, root)}")
        for x in sorted(direct(p) | inside[p]):
            print(f"    {x[0]} {x[1]}: {shown[x]}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
