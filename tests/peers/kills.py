"""Shards are the same bits made at once, after kill -9, alone, and on another number of threads;
damage is found and named. The suite has a version of seconds (tests/collect.rs).

Run with: python tests/peers/kills.py ROBERT [ROBOT] [KILLS]     (ROBERT: path of the binary)
"""

import hashlib
import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

AGENTS = "rnd,icm,apt,aps,proto,noise"


def main(robert, robot="ur5e", kills="30"):
    with tempfile.TemporaryDirectory(prefix="kills-") as work:
        torture(pathlib.Path(work), robert, robot, kills)


def torture(work, robert, robot, kills):
    draw = random.Random(1)

    def command(out, *more):
        steps = ["--agent-steps", "1000", "--transitions", "30000", "--seed", "7"]
        return [robert, "collect", "--robot", robot, "--agent", AGENTS, *steps, "--json", "--out", str(work / out), *more]

    def collect(out, *more):
        done = subprocess.run(command(out, *more), stdout=subprocess.PIPE, check=True)
        return json.loads(done.stdout)["manifest_sha256"]

    def files(out):
        found = sorted((work / out / "shards").glob("*.safetensors"))
        return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in found}

    began = time.time()
    whole = collect("whole")
    wall, shards = time.time() - began, files("whole")
    assert collect("single", "--threads", "1") == whole and files("single") == shards

    fired = 0
    while fired < int(kills):
        child = subprocess.Popen(command("killed", "--resume"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(draw.uniform(0.005, 0.3 * wall))
        finished = child.poll() is not None
        child.kill()
        child.wait()
        fired += not finished
        if finished:
            # Begun anew, with one shard missing and one cut short, so that each is made alone.
            assert files("killed") == shards
            paths = sorted((work / "killed/shards").glob("*.safetensors"))
            draw.choice(paths[::2]).unlink()
            hurt = draw.choice(paths[1::2])
            hurt.write_bytes(hurt.read_bytes()[: hurt.stat().st_size // 2])
            if draw.random() < 0.5:
                shutil.rmtree(work / "killed")
    assert collect("killed", "--resume") == whole and files("killed") == shards

    named = 0
    for path in sorted((work / "whole/shards").glob("*.safetensors")):
        good = path.read_bytes()
        flipped = bytearray(good)
        flipped[draw.randrange(len(good))] ^= 1 << draw.randrange(8)
        for bad in (bytes(flipped), good[: draw.randrange(len(good))], good + b"\0", b""):
            path.write_bytes(bad)
            done = subprocess.run([robert, "dataset", "check", str(work / "whole")], capture_output=True, text=True)
            assert done.returncode == 3 and path.name in done.stdout, (path.name, len(bad), done.stdout)
            named += 1
        path.write_bytes(good)
    done = subprocess.run([robert, "dataset", "check", str(work / "whole")], capture_output=True)
    assert done.returncode == 0
    print(f"{robot}: {len(shards)} shards, {fired} kills, {named} damaged files named: ok")


if __name__ == "__main__":
    main(*sys.argv[1:])
