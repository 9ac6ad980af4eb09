"""kill -9 at any moment of saving, exporting, collecting, training, `robert new`, shards and their merge: what has
its final name is whole, an older file stands until then, the work can go on, and no process is left after 2 s.

Run with: python tests/peers/kill_everything.py ROBERT [KILLS] [KIND...]     (ROBERT: path of the binary)

KILLS is the number of all kinds of work together, 1,000 if not said: quick work is killed more often. Edits are killed by
`ROBERT_KILLS=200 cargo test --test it studio::crash`; kills.py looks closer at the parts of a collection.
"""

import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
import uuid

QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
ARM = pathlib.Path(__file__).resolve().parents[2] / "examples/arm.urdf"


class Killer:
    """Starts work with a mark in its environment, by which its children are found."""

    def __init__(self, robert, work):
        self.robert, self.work, self.draw = robert, work, random.Random(1)
        self.mark = f"ROBERT_KILLED_BY={uuid.uuid4()}"
        name, value = self.mark.split("=")
        self.settings = {**os.environ, name: value, "ROBERT_STATE_DIR": str(work / "state"), "XDG_CACHE_HOME": str(work / "cache")}

    def start(self, *args, **more):
        return subprocess.Popen([self.robert, *map(str, args)], cwd=self.work, env=self.settings, **{**QUIET, **more})

    def run(self, *args, **more):
        done = subprocess.run([self.robert, *map(str, args)], cwd=self.work, env=self.settings, capture_output=True, text=True, **more)
        assert done.returncode == 0, (args, done.returncode, done.stderr[-2000:])
        return done.stdout

    def kill(self, child, longest):
        """Kills it at a moment of the first `longest` seconds; whether it was still at work."""
        time.sleep(self.draw.uniform(0.0, longest))
        alive = child.poll() is None
        child.kill()
        child.wait()
        return alive

    def left(self):
        """Processes that bear the mark."""
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    if self.mark.encode() in (entry / "environ").read_bytes().split(b"\0"):
                        state = (entry / "stat").read_text().rsplit(")")[1].split()[0]
                        if state != "Z":
                            found.append((entry.name, (entry / "cmdline").read_bytes()))
                except OSError:
                    pass
        return found

    def no_orphans(self):
        until = time.time() + 2.0
        while self.left() and time.time() < until:
            time.sleep(0.05)
        assert not self.left(), self.left()

    def timed(self, *args):
        begin = time.time()
        self.run(*args)
        return time.time() - begin


def tree(folder):
    """Sha-256 of every file below, those of killed writers aside."""
    files = [p for p in folder.rglob("*") if p.is_file() and not any(part.startswith(".robert-") for part in p.relative_to(folder).parts)]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def saves(k, kills):
    """A studio that edits and saves as fast as it can: the file is always one that was asked for."""
    path = k.work / "saved.clip.json"
    new = {"robot": "pointmass", "length": 40, "name": "n0"}
    acknowledged = 0
    for kill in range(kills):
        path.unlink(missing_ok=True)
        shutil.rmtree(k.work / "state", ignore_errors=True)
        for stale in k.work.glob("saved.clip.json.autosave*"):
            stale.unlink()
        child = k.start("studio", "--no-open", "--port", "0", stdout=subprocess.PIPE, text=True)
        base, token = child.stdout.readline().strip().split("/#token=")

        def ask(where, body):
            head = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
            return json.load(urllib.request.urlopen(urllib.request.Request(base + where, json.dumps(body).encode(), head), timeout=20))

        ask("/api/new", new)
        begin = time.time()
        ask("/api/save", {"path": str(path)})
        # Some saves on a machine of any speed.
        until = time.time() + k.draw.uniform(0.0, max(0.3, 10 * (time.time() - begin)))
        pid = os.fork()
        if pid == 0:
            time.sleep(max(0.0, until - time.time()))
            os.kill(child.pid, signal.SIGKILL)
            os._exit(0)
        saved, asked = 0, 0
        try:
            while True:
                asked += 1
                ask("/api/ops", {"label": "", "ops": [{"op": "clip.rename", "args": {"name": f"n{asked}"}}]})
                ask("/api/save", {})
                saved = asked
        except OSError:
            pass
        os.waitpid(pid, 0)
        child.wait()
        child.stdout.close()
        name = json.loads(path.read_text())["name"]
        assert saved <= int(name[1:]) <= asked, (kill, name, saved, asked)
        acknowledged += saved
        k.no_orphans()
    return f"{acknowledged} acknowledged saves, none lost or half written"


def exports(k, kills):
    """One file and a folder of many; an older export stands until the new one is whole."""
    k.run("rollout", "shadow_hand/rsp", "-p", "pd", "--out", "take.mcap")
    kinds = [("glb", "out.glb"), ("lerobot", "out_lerobot"), ("minari", "out_minari"), ("csv", "out.csv"), ("mcap", "out.mcap")]
    whole, secs = {}, {}
    for to, out in kinds:
        secs[to] = k.timed("export", "take.mcap", "--to", to, "-o", out)
        place = k.work / out
        whole[to] = tree(place) if place.is_dir() else hashlib.sha256(place.read_bytes()).hexdigest()
    cut, there = 0, 0
    for kill in range(kills):
        to, out = kinds[kill % len(kinds)]
        place = k.work / out
        if kill % 2:
            shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
        cut += k.kill(k.start("export", "take.mcap", "--to", to, "-o", out), 1.2 * secs[to])
        if place.is_file():
            assert hashlib.sha256(place.read_bytes()).hexdigest() == whole[to], (to, kill)
            there += 1
        elif place.is_dir():
            found = tree(place)
            assert found.items() <= whole[to].items(), (to, kill)
            there += 1
        k.no_orphans()
        k.run("export", "take.mcap", "--to", to, "-o", out)
        found = tree(place) if place.is_dir() else hashlib.sha256(place.read_bytes()).hexdigest()
        assert found == whole[to], (to, kill)
    return f"{cut} while at work, {there} files or folders there afterwards, all whole; each export succeeds again"


def collections(k, kills):
    """Gone on with, it has the bits of one that was never killed."""
    options = ["--robot", "ur5e", "--agent", "noise,babble", "--transitions", "20000", "--seed", "3", "--out"]
    secs = k.timed("collect", *options, "data")
    # The picture of what was visited comes after the data, and is no part of them.
    def data(folder):
        return {name: sha for name, sha in tree(folder).items() if name != "coverage.png"}

    whole = data(k.work / "data")
    cut, ends = 0, 0
    out = k.work / "killed"
    while cut < kills:
        cut += k.kill(k.start("collect", *options, "killed", "--resume"), 0.9 * secs)
        k.no_orphans()
        shards = {name: sha for name, sha in data(out).items() if name.startswith("shards/")} if out.is_dir() else {}
        assert all(whole.get(name) == sha for name, sha in shards.items()), cut
        if out.is_dir() and "manifest.json" in tree(out):
            assert data(out) == whole, set(data(out).items()) ^ set(whole.items())
            shutil.rmtree(out)
            ends += 1
    if out.is_dir():
        k.run("collect", *options, "killed", "--resume")
        assert data(out) == whole
    return f"{cut} while at work, {ends + 1} collections gone on with to the same bits"


def trainings(k, kills):
    """Each stop leaves checkpoints that load; the run that was killed over and over ends with the same weights."""
    options = ["--robot", "ur5e", "--data", "data", "--preset", "instant", "--set", "steps=150", "--out"]
    secs = k.timed("train", *options, "run")
    weights = {n: s for n, s in tree(k.work / "run").items() if n.endswith("best.safetensors")}
    assert weights, tree(k.work / "run")
    cut, ends, out = 0, 0, k.work / "killed_run"
    while cut < kills:
        begun = (out / "config.toml").exists()
        more = ["--robot", "ur5e", "--data", "data", "--resume", "killed_run"] if begun else [*options, "killed_run"]
        # The bits do not depend on the number of threads either.
        child = k.start("train", *more, "--threads", k.draw.choice([1, 2]))
        alive = k.kill(child, secs)
        cut += alive
        k.no_orphans()
        for path in out.rglob("*.safetensors"):
            if not path.name.startswith(".robert-"):
                raw = path.read_bytes()
                head = json.loads(raw[8 : 8 + int.from_bytes(raw[:8], "little")])
                assert len(raw) == 8 + int.from_bytes(raw[:8], "little") + max(t["data_offsets"][1] for n, t in head.items() if n != "__metadata__"), path
        if not alive and child.returncode == 0:
            assert {n: s for n, s in tree(out).items() if n.endswith("best.safetensors")} == weights, "other weights"
            shutil.rmtree(out)
            ends += 1
        elif out.is_dir() and not (out / "config.toml").exists():
            shutil.rmtree(out)
    return f"{cut} while at work, every checkpoint whole, {ends} runs ended with the same weights"


def news(k, kills):
    """`robert new` goes on where it was, and what it made is a robot."""
    options = ["new", ARM, "--out", "arm", "--transitions", "10000", "--minutes", "0"]
    secs = k.timed(*options)
    whole = {n for n in tree(k.work / "arm")}
    cut, ends = 0, 0
    shutil.rmtree(k.work / "arm")
    while cut < kills:
        child = k.start(*options)
        alive = k.kill(child, secs)
        cut += alive
        k.no_orphans()
        if (k.work / "arm/profile.toml").exists() and (k.work / "arm/robot.xml").exists():
            k.run("robots", "show", "arm")
        if not alive and child.returncode == 0:
            assert {n for n in tree(k.work / "arm")} == whole, {n for n in tree(k.work / "arm")} ^ whole
            shutil.rmtree(k.work / "arm")
            ends += 1
        elif not alive:
            raise AssertionError((child.returncode, "does not go on"))
    k.run(*options)
    return f"{cut} while at work, {ends + 1} robots finished"


SPECS = {
    "collect": 'kind = "collect"\nrobot = "ur5e"\ntransitions = 40_000\nshards = 16\n',
    "eval": 'kind = "eval"\nrobot = "pointmass"\nsuites = ["manual"]\npolicies = ["pd", "ridge"]\nseeds = 4\ntasks_per_shard = 4\n',
}


def shards(k, kills):
    """The pool, one shard or the merge is killed: no part of a shard is ever merged, and what is merged in the end has the
    bits of work that was never killed."""
    def finished():
        """The shards that are done, and all that were planned."""
        told = json.loads(k.run("shard", "status", "work", "--json"))
        assert not told["corrupt"], told
        return told["done"], told["shards"]

    def merge_refuses():
        done = subprocess.run([k.robert, "shard", "merge", "work", "--out", "merged"], cwd=k.work, env=k.settings, capture_output=True, text=True)
        assert done.returncode != 0 and "error: " in done.stderr, done.stderr
        assert not (k.work / "merged").exists(), "a merge of what is not whole"

    cut, merges, refused, ends = 0, 0, 0, 0
    kinds = list(SPECS)
    whole, secs, merge_secs = {}, {}, {}
    for kind in kinds:
        (k.work / f"{kind}.toml").write_text(SPECS[kind])
        k.run("shard", "plan", f"{kind}.toml", "--out", f"{kind}-whole")
        secs[kind] = k.timed("shard", "submit", f"{kind}-whole", "--backend", "local", "--jobs", "2")
        merge_secs[kind] = k.timed("shard", "merge", f"{kind}-whole", "--out", f"{kind}-merged")
        whole[kind] = tree(k.work / f"{kind}-merged")
    while cut < kills:
        kind = kinds[ends % len(kinds)]
        k.run("shard", "plan", f"{kind}.toml", "--out", "work")
        while True:
            done, planned = finished()
            if len(done) == planned:
                break
            if cut % 3 == 2:
                missing = k.run("shard", "missing", "work").split()
                child = k.start("shard", "run", "work", "--index", k.draw.choice(missing))
            else:
                child = k.start("shard", "submit", "work", "--backend", "local", "--jobs", "2")
            cut += k.kill(child, 0.7 * secs[kind] / (4 if cut % 3 == 2 else 1))
            k.no_orphans()
            now, _ = finished()
            assert set(done) <= set(now), "a shard that was done is not any more"
            if len(now) < planned:
                merge_refuses()
                refused += 1
        for _ in range(2):
            alive = k.kill(k.start("shard", "merge", "work", "--out", "merged"), 1.2 * merge_secs[kind])
            cut, merges = cut + alive, merges + alive
            k.no_orphans()
            if (k.work / "merged").exists():
                assert tree(k.work / "merged") == whole[kind], "half a merge"
                shutil.rmtree(k.work / "merged")
        k.run("shard", "merge", "work", "--out", "merged")
        assert tree(k.work / "merged") == whole[kind], set(tree(k.work / "merged").items()) ^ set(whole[kind].items())
        for folder in ["work", "merged"]:
            shutil.rmtree(k.work / folder)
        ends += 1
    return f"{cut} while at work ({merges} of them merges), {refused} merges of unfinished work refused, {ends} ended with the same bits"


SHARES = {saves: 0.39, exports: 0.38, collections: 0.1, trainings: 0.06, news: 0.04, shards: 0.03}


def main(robert, kills="1000", *only):
    robert = str(pathlib.Path(robert).resolve())
    with tempfile.TemporaryDirectory(prefix="kills-") as work:
        for kind, share in SHARES.items():
            begin = time.time()
            # Training needs the data of the collection.
            count = max(1, round(int(kills) * share))
            if only and kind.__name__ not in only:
                if kind is not collections or "trainings" not in only:
                    continue
                count = 1
            print(f"{kind.__name__}: {count} kills, {kind(Killer(robert, pathlib.Path(work)), count)}, {time.time() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
