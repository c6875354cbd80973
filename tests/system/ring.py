"""Account of takes that triggers began: each frame number between the first and the last of a camera is in the take, in
a gap or in a row of lost frames, and the take reaches from before its instant to after it.
    ring.py TAKE.h5...   exits with 1 and names what is missing"""
import sys

import h5py
import numpy as np


def account(path):
    wrong, frames, lost = [], 0, {}
    with h5py.File(path, "r") as f:
        if f.attrs["closed"] != 1:
            wrong.append("not closed")
        period = 1e9 / f.attrs["fps"]
        trigger = f["triggers"][:]
        t_from, t_to = trigger["t_from_ns"].min(), trigger["t_to_ns"].max()
        rows = f["lost"][:]
        if len(f["gaps"]) > 0:
            lost["queue"] = int(f["gaps"]["frames"].sum())
        for r in rows:
            why = r["why"].decode()
            lost[why] = lost.get(why, 0) + int(r["frames"])
        for name, c in f["cameras"].items():
            number = c.attrs["number"]
            mine = rows[rows["camera"] == number]
            if "index" not in c:
                if len(mine) == 0:
                    wrong.append(f"{name}: no frames, and not named")
                continue
            i = c["index"][:]
            frames += len(i)
            named = [(int(r["id_first"]), int(r["id_last"])) for r in mine if r["id_last"] > 0]
            unnumbered = [(int(r["t_first_ns"]), int(r["t_last_ns"])) for r in mine if r["id_last"] == 0]
            timed = [(int(r["t_first_ns"]), int(r["t_last_ns"])) for r in mine]
            gaps = [g for g in f["gaps"][:] if g["camera"] == number]
            named += [(int(g["id_first"]), int(g["id_last"])) for g in gaps]
            timed += [(int(g["t_first_ns"]) - int(period), int(g["t_last_ns"]) + int(1.6 * period)) for g in gaps]
            order = np.argsort(i["id"], kind="stable")
            ids, t = i["id"][order].astype(np.int64), i["t_exposure_ns"][order]
            if np.any(i["t_exposure_ns"] < t_from) or np.any(i["t_exposure_ns"] > t_to):
                # members of a set lie within its spread around the set's time
                if np.any(i["t_exposure_ns"] < t_from - period) or np.any(i["t_exposure_ns"] > t_to + period):
                    wrong.append(f"{name}: a frame outside the asked time")
            if len(np.unique(ids)) != len(ids):
                wrong.append(f"{name}: a frame twice")
            for a, b, ta, tb in zip(ids[:-1], ids[1:], t[:-1], t[1:]):
                missing = [k for k in range(a + 1, b) if not any(x <= k <= y for x, y in named)]
                if missing and not any(x <= tb and y >= ta for x, y in unnumbered):
                    wrong.append(f"{name}: numbers {missing[0]}..{missing[-1]} are missing and not named")
            # A frame of each end, or a named loss there.  The daemon itself may have begun later than the asked time.
            first = t[0] <= t_from + 1.6 * period or any(x <= t[0] for x, y in timed)
            last = t[-1] >= t_to - 1.6 * period or any(y >= t[-1] for x, y in timed)
            if not first and f["sets"]["number"][0] > 2:
                wrong.append(f"{name}: begins {(t[0] - t_from) * 1e-6:.1f} ms too late")
            if not last:
                wrong.append(f"{name}: ends {(t_to - t[-1]) * 1e-6:.1f} ms too early")
    return wrong, frames, lost


def window(path):
    """The exposures that the take was asked for."""
    with h5py.File(path, "r") as f:
        t = f["triggers"][:]
        return int(t["t_from_ns"].min()), int(t["t_to_ns"].max())


def main():
    bad = 0
    for path in sys.argv[1:]:
        wrong, frames, lost = account(path)
        print(path.rsplit("/", 1)[-1], frames, "frames, lost", lost or "none", *wrong, sep="  ")
        bad += bool(wrong)
    if bad or len(sys.argv) < 2:
        sys.exit(f"{bad} takes with frames that are not accounted for")


if __name__ == "__main__":
    main()
