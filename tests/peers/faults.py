"""Every operation on files fails once: the Nth write, fsync, rename and so on, N = 1, 2, 3 until none is left to
fail. The old file stands or the new one is whole, no process panics, the message names a path, nothing is
left lying about, and the same command succeeds afterwards.

Run with: python tests/peers/faults.py ROBERT [NAME...]     (strace must be installed; ROBERT: path of the binary)
"""

import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

# What changes files. (mmap and openat are left to the loader, which fails before the program starts.)
CALLS = ["write", "pwrite64", "writev", "fsync", "fdatasync", "rename", "renameat", "renameat2", "ftruncate", "fchmod", "mkdir", "linkat", "unlink", "copy_file_range", "fallocate"]
ERRORS = ["ENOSPC", "EIO"]
MOST = 400


def tree(folder):
    """Sha-256 of every file below."""
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.rglob("*")) if p.is_file()}


def whole(path):
    """A safetensors file is as long as its header says."""
    raw = path.read_bytes()
    start = 8 + int.from_bytes(raw[:8], "little")
    tensors = [t for name, t in json.loads(raw[8:start]).items() if name != "__metadata__"]
    return len(raw) == start + max(t["data_offsets"][1] for t in tensors)


class Work:
    """A command in a folder of its own. `setup` makes what it needs, `made` is what it makes."""

    def __init__(self, robert, base, name, setup, args, made):
        self.robert, self.name, self.setup, self.args, self.made = robert, name, setup, args, made
        self.base = base / name
        self.settings = {**os.environ, "NO_COLOR": "1", "XDG_CACHE_HOME": str(base / "cache"), "ROBERT_STATE_DIR": str(base / "state")}

    def run(self, *before):
        command = [*before, self.robert, *self.args]
        return subprocess.run(command, cwd=self.base, env=self.settings, capture_output=True, text=True)

    def fresh(self):
        shutil.rmtree(self.base, ignore_errors=True)
        self.base.mkdir(parents=True)
        for args in self.setup:
            subprocess.run([self.robert, *args], cwd=self.base, env=self.settings, check=True, capture_output=True)
        return tree(self.base)

    def torture(self):
        old = self.fresh()
        done = self.run()
        assert done.returncode == 0, done.stderr
        new = tree(self.base)
        assert new != old, "it changes nothing"
        hits, refused = 0, 0
        for call in CALLS:
            for error in ERRORS:
                for n in range(1, MOST):
                    assert self.fresh() == old
                    log = self.base.parent / "strace"
                    done = self.run("strace", "-f", "-qq", "-o", log, "-e", f"trace={call}", "-e", f"inject={call}:error={error}:when={n}")
                    if "(INJECTED)" not in log.read_text():
                        break
                    hits += 1
                    refused += self.check(f"{call} {n} {error}", done, old, new)
                else:
                    raise AssertionError(f"{self.name}: more than {MOST} calls of {call}")
        return hits, refused

    def check(self, what, done, old, new):
        """One fault; whether the command failed for it."""
        place = f"{self.name}, {what}: {done.returncode} {done.stderr[-600:]}"
        assert "panicked" not in done.stderr, place
        assert done.returncode in (0, 1, 3), place
        found = tree(self.base)
        for name in self.made:
            # Files in a folder come one by one, each whole.
            for path, sha in found.items():
                if path == name or path.startswith(name + "/"):
                    known = sha in (old.get(path), new.get(path)) or done.returncode == 0 or self.volatile(path)
                    # A checkpoint of an earlier step is whole, too.
                    assert known or (path.endswith(".safetensors") and whole(self.base / path)), (place, path)
        assert not [p for p in found if "/.robert-" in f"/{p}"], (place, list(found))
        if done.returncode == 0:
            return False
        said = done.stderr.strip().splitlines()
        if said and "write" not in what.split()[0]:
            # A failed write may be the one to the terminal.
            assert any(l.startswith("error: ") and any(name in l for name in [*(made.split("/")[0] for made in self.made), ".robert", "cache"]) for l in said), place
        if found == new:
            # Only what it says of it was lost.
            return True
        again = self.run()
        if again.returncode != 0 and "--resume" in again.stderr:
            # A run is gone on with by its name, a collection by its options.
            args = [*self.args[: self.args.index("--preset")], "--resume", "run", "-q"] if self.args[0] == "train" else [*self.args, "--resume"]
            again = subprocess.run([self.robert, *args], cwd=self.base, env=self.settings, capture_output=True, text=True)
        assert again.returncode == 0, (place, "again:", again.stderr[-600:])
        ends = tree(self.base)
        for path in new:
            # A picture of the data or of the training comes after them, and is no part of them.
            if any(path == name or path.startswith(name + "/") for name in self.made) and not self.volatile(path) and not path.endswith(".png"):
                assert ends.get(path) == new[path], (place, "again, another", path)
        return True

    @staticmethod
    def volatile(path):
        """Logs and times differ from run to run."""
        return path.endswith((".jsonl", ".log", "run.json", "manifest.json", "config.toml", ".lock"))


def works(robert, base):
    clip = ["clip", "new", "--robot", "pointmass", "-o", "a.clip.json"]
    op = base / "op.json"
    op.write_text('{"op": "clip.rename", "args": {"name": "changed"}}')
    data = ["collect", "--robot", "pointmass", "--agent", "noise", "--transitions", "2000", "--out", "data", "--threads", "1"]
    take = ["rollout", "circle", "-p", "pd", "--out", "take.mcap", "-q"]
    def work(name, setup, args, made):
        return Work(robert, base, name, setup, [str(a) for a in args], made)
    return [
        work("save", [clip], ["clip", "apply", "a.clip.json", op, "--in-place"], ["a.clip.json"]),
        work("csv", [clip], ["clip", "convert", "a.clip.json", "a.csv"], ["a.csv"]),
        work("take", [], take, ["take.mcap"]),
        work("glb", [take], ["export", "take.mcap", "--to", "glb", "-o", "a.glb", "-q"], ["a.glb"]),
        work("lerobot", [take], ["export", "take.mcap", "--to", "lerobot", "-o", "set", "-q"], ["set"]),
        work("collect", [], [*data, "-q"], ["data"]),
        work("checkpoint", [data], ["train", "--robot", "pointmass", "--data", "data", "--preset", "instant", "--set", "steps=4", "--out", "run", "--threads", "1", "-q"], ["run/ckpt", "run/model.safetensors"]),
    ]


def autosave(robert, base):
    """The journal of a studio: an edit that cannot be written is refused and taken back, and the next one works."""
    hits, refused = 0, 0
    for call in ["fdatasync", "fsync", "pwrite64", "ftruncate", "rename", "renameat", "renameat2"]:
        for n in range(1, 60):
            folder = base / "studio"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            settings = {**os.environ, "NO_COLOR": "1", "ROBERT_STATE_DIR": str(folder / "state"), "ROBERT_LOG": "error"}
            path, log = folder / "a.clip.json", base / "strace"
            start = [robert, "studio", "--no-open", "--port", "0"]
            trace = ["strace", "-f", "-qq", "-o", log, "-e", f"trace={call}", "-e", f"inject={call}:error=EIO:when={n}"]
            child = subprocess.Popen([*map(str, trace), *start], cwd=folder, env=settings, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            names = ["start"]
            line = child.stdout.readline().strip()
            if line:
                base_url, token = line.split("/#token=")

                def ask(where, body=None, to=(base_url, token)):
                    head = {"Authorization": f"Bearer {to[1]}", "Content-Type": "application/json"}
                    data = None if body is None else json.dumps(body).encode()
                    try:
                        return json.load(urllib.request.urlopen(urllib.request.Request(to[0] + where, data, head), timeout=30)), True
                    except urllib.error.HTTPError as e:
                        return json.loads(e.read()), False

                def told(answer, good):
                    assert good or "." in answer["message"] or "/" in answer["message"], answer
                    return 0 if good else 1

                saved = None
                refused += told(*ask("/api/new", {"robot": "pointmass", "length": 20, "name": "start"}))
                for step in range(6):
                    if ask("/api/state")[0]["document"] is None:
                        ask("/api/new", {"robot": "pointmass", "length": 20, "name": "start"})
                    answer, good = ask("/api/ops", {"label": "", "ops": [{"op": "clip.rename", "args": {"name": f"n{step}"}}]})
                    refused += told(answer, good)
                    names = [f"n{step}"] if good else names
                    shown = ask("/api/state")[0]["document"]["clip"]["name"]
                    assert shown in names, (call, n, shown, names)
                    if step in (2, 4):
                        answer, good = ask("/api/save", {"path": str(path), "replace": True})
                        refused += told(answer, good)
                        saved = shown if good else saved
                        assert not path.exists() or json.loads(path.read_text())["name"] in (saved, shown), (call, n)
            for entry in pathlib.Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split():
                os.kill(int(entry), 9)
            child.wait()
            child.stdout.close()
            hit = "(INJECTED)" in log.read_text()
            hits += hit
            if line:
                again = subprocess.Popen([*start, *(["a.clip.json"] if path.exists() else [])], cwd=folder, env=settings, stdout=subprocess.PIPE, text=True)
                line = again.stdout.readline().strip()
                assert line, (call, n, "does not start again")
                base_url, token = line.split("/#token=")
                document = json.load(urllib.request.urlopen(urllib.request.Request(base_url + "/api/state", headers={"Authorization": f"Bearer {token}"}), timeout=30))["document"]
                assert document and document["clip"]["name"] in names, (call, n, document and document["clip"]["name"], names)
                again.kill()
                again.wait()
                again.stdout.close()
            if not hit:
                break
    return hits, refused


def main(robert, *only):
    robert = str(pathlib.Path(robert).resolve())
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        base = pathlib.Path(folder)
        kinds = [(w.name, w.torture) for w in works(robert, base)]
        kinds.append(("autosave", lambda: autosave(robert, base)))
        for name, torture in kinds:
            if only and name not in only:
                continue
            begin = time.time()
            hits, refused = torture()
            print(f"{name}: {hits} faults, {refused} told, {time.time() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
