"""Files of at most 16 MB that are made to cost as much as they can, through every reader: each is read or refused
within 2 s of processor time and 512 MB, children included.

Run with: python tests/peers/worst_shapes.py ROBERT [NAME...]     (ROBERT: path of a release binary)
"""

import io
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile

MB = 1 << 20
MOST = 16 * MB
SECS, KB = 2.0, 512 << 10
UR5E = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"]


def fill(head, item, tail="", most=MOST - 1000):
    """Head, as many items as there is room for, tail."""
    return head + item * ((most - len(head) - len(tail)) // len(item)) + tail


def clip(rest, joints=("a", "b"), length=100, robot="r"):
    names = json.dumps(list(joints))
    return f'{{"format":"robert-clip/1","robot":{{"id":"{robot}","joints":{names}}},"fps":20,"length":{length},{rest}}}'


def clips():
    many = [f"j{i}" for i in range(256)]
    row = ",".join(["0.123456"] * 256)
    keys = ",".join(f'{{"frame":{2 * i},"q":[0,1]}}' for i in range(50_000))
    reach = ",".join(f'{{"frame":{i},"q":[0,-1.5,1.5,-1.5,-1.5],"reach":[{{"site":"end_effector","pos":[{0.4 + 0.3 * (i % 7) / 7},{0.5 * (i % 3) - 0.5},0.4]}}]}}' for i in range(4096))
    far = ",".join(f'{{"frame":{i},"q":[0,-1.5,1.5,-1.5,-1.5],"reach":[{{"site":"end_effector","pos":[{9 + i % 7},9,9]}}]}}' for i in range(4096))
    path = ",".join(f'{{"frame":{i * 4999},"q":[0,-1.5,1.5,-1.5,-1.5],"reach":[{{"site":"end_effector","pos":[{0.4 + i / 9},0.2,0.4]}}],"fill":"linear"}}' for i in range(3))
    spans = ",".join('{"from":%d,"to":%d}' % (i % 99, i % 99 + 1) for i in range(50_000))
    named = json.dumps(many)
    return {
        "nested arrays": clip('"x":' + "[" * (8 * MB)),
        "nested objects": clip('"x":' + '{"a":' * (3 * MB)),
        "shut arrays": clip('"x":{"a":' + "[" * (7 * MB) + "]" * (7 * MB) + '},"keys":[]'),
        "long string": clip(fill('"keys":[],"notes":"', "a", '"')),
        "escapes": clip(fill('"keys":[],"notes":"', "\\u0041", '"')),
        "long number": clip(fill('"keys":[{"frame":1,"q":[0,', "9", "]}]")),
        "exponents": clip(fill('"keys":[{"frame":1,"q":[', "1e-300,", "0]}]")),
        "same name": clip(fill("", '"x":{},', '"keys":[]')),
        "extras": clip('"keys":[],"x":{"a":[' + ",".join(["1"] * 8_000_000) + "]}"),
        "keys": clip(f'"keys":[{keys}]', length=100_000),
        "wide keys": clip('"keys":[' + ",".join(f'{{"frame":{i},"q":[{row}]}}' for i in range(7000)) + "]", many, 16_000),
        "long command": clip('"keys":[{"frame":0,"q":[0,0]},{"frame":99999,"q":[1,1]}],"fill":"cubic"', length=100_000),
        "spans": clip(f'"keys":[{keys}],"masks":[{spans}]', length=100_000),
        "spans of joints": clip('"keys":[],"masks":[' + ",".join('{"from":0,"to":99,"joints":%s}' % named for _ in range(1024)) + "]", many),
        "poses": clip('"keys":[],"poses":{' + ",".join(f'"p{i}":[0,0]' for i in range(10_000)) + "}"),
        "goals": clip(f'"keys":[{reach}]', UR5E, 5000, "ur5e"),
        "goals out of reach": clip(f'"keys":[{far}]', UR5E, 5000, "ur5e"),
        "straight paths": clip(f'"keys":[{path}]', UR5E, 100_000, "ur5e"),
        "spaces": fill(" ", " "),
    }


def csvs():
    head = "frame,time_s," + ",".join(UR5E) + "\n"
    return {
        "commas": fill("", ","),
        "lines": fill("", "\n"),
        "quotes": fill("", '"'),
        "open quote": fill(head + '0,0,"', "a,\n"),
        "rows": head + "".join(f"{i},{i / 20},0,0,0,0,0\n" for i in range(500_000)),
        "wide": ",".join(f"j{i}" for i in range(1_500_000)),
        "digits": fill(head + "0,0,", "9", ",0,0,0,0"),
    }


def yamls():
    head = "joint_names: [" + ", ".join(UR5E) + "]\npoints:\n"
    point = "- {positions: [0, 0, 0, 0, 0], time_from_start: {sec: 1, nanosec: 0}}\n"
    laughs = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 40))
    return {
        "points": fill(head, point),
        "flow": fill("", "["),
        "maps": fill("", "{a: "),
        "dashes": fill("", "- "),
        "questions": fill("", "? "),
        "laughs": laughs,
        "aliases": fill("joint_names: [&a b]\npoints: [", "*a, "),
        "anchors": fill("joint_names: [", "&a b, "),
        "comments": fill(head, "#\n"),
        "long scalar": fill("joint_names: [", "a"),
        "block scalar": fill("joint_names: |\n", "  a\n"),
        "documents": fill("", "---\n"),
        "deeper and deeper": "".join(" " * i + "a:\n" for i in range(5000)),
        "merges": fill("a: &a {b: c}\n", "<<: *a\n"),
        "tags": fill("joint_names: ", "!a "),
        "folded": fill('joint_names: "', "a\n\n"),
    }


def commands():
    row = ",".join(["0"] * 5)
    return {
        "nested": fill("", "["),
        "rows": '{"joints":%s,"frames":[%s]}' % (json.dumps(UR5E), ",".join(f"[{row}]" for _ in range(1_200_000))),
        "names": '{"joints":[%s]}' % ",".join(f'"j{i}"' for i in range(1_500_000)),
        "nulls": fill('{"joints":["a"],"q":[', "null,", "null]}"),
    }


def xmls():
    return {
        "elements": fill("<mujoco><keyframe>", "<key/>", "</keyframe></mujoco>"),
        "keys": "<mujoco><keyframe>" + "".join(f'<key time="{i}" qpos="0 0 0 0 0"/>' for i in range(150_000)) + "</keyframe></mujoco>",
        "deep": fill("", "<a>"),
        "attributes": "<mujoco><key " + " ".join(f'a{i}="1"' for i in range(900_000)) + "/></mujoco>",
        "numbers": fill('<mujoco><keyframe><key qpos="', "0 ", '"/></keyframe></mujoco>'),
        "entities": fill('<mujoco a="', "&amp;", '"/>'),
        "comments": fill("<mujoco>", "<!---->", "</mujoco>"),
        "open comments": fill("<mujoco>", "<!--"),
        "brackets": fill("", "<"),
        "texts": fill("<mujoco>", "a<b/>", "</mujoco>"),
        "instructions": fill("<mujoco>", "<?a?>", "</mujoco>"),
        "namespaces": fill("<mujoco>", '<a xmlns:b="c"/>', "</mujoco>"),
        "unclosed quotes": fill("<mujoco>", '<a b="'),
    }


def models():
    body = '<body name="b{0}"><joint name="j{0}" axis="0 0 1"/><geom size=".1" pos="{0} 0 0"/></body>'
    motors = "<actuator>" + "".join(f'<motor joint="j{i}"/>' for i in range(2)) + "</actuator>"
    world = lambda inner, more="": f"<mujoco>{more}<worldbody>{body.format(0)}{body.format(1)}{inner}</worldbody>{motors}</mujoco>"
    link = '<link name="l{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>'
    heavy = link.replace('value="1"', 'value="1000"').replace('xx="1" iyy="1" izz="1"', 'xx="1000" iyy="1000" izz="1000"')
    # Chains of fifty links, too heavy to become fast.
    comb = lambda n: "<robot name='r'>" + "".join(heavy.format(i) for i in range(n)) + "".join(joint.format(i, 0 if i % 50 == 1 else i - 1) for i in range(1, n)) + "</robot>"
    overlap = lambda n: world("").replace("</body>", '<geom size=".1"/>' * n + "</body>")
    wide = lambda n: "<robot name='r'>" + "".join(link.format(i) for i in range(n)) + "".join(joint.format(i, 0) for i in range(1, n)) + "</robot>"
    return {
        **{f"{name}.xml": text[: 8 * MB] for name, text in xmls().items()},
        "bodies.xml": world("".join(body.format(i) for i in range(2, 1000))),
        "geoms.xml": world("".join(f'<geom size=".1" pos="{i} 0 0"/>' for i in range(19_000))),
        "mesh numbers.xml": world("", fill('<asset><mesh name="m" vertex="', "0 1 0 ", '"/></asset>', 7 * MB)),
        "materials.xml": world("", "<asset>" + "".join(f'<material name="m{i}"/>' for i in range(60_000)) + "</asset>"),
        "defaults.xml": world("", "<default>" + "".join(f'<default class="c{i}"><geom size=".1"/></default>' for i in range(20_000)) + "</default>"),
        "excludes.xml": world("", "<contact>" + "".join('<exclude body1="b0" body2="b1"/>' for _ in range(100_000)) + "</contact>"),
        "equalities.xml": world("", "<equality>" + "".join('<joint joint1="j0" joint2="j1"/>' for _ in range(50_000)) + "</equality>"),
        "sensors.xml": world("", "<sensor>" + "".join('<jointpos joint="j0"/>' for _ in range(100_000)) + "</sensor>"),
        "tendons.xml": world("", "<tendon>" + "".join('<fixed><joint joint="j0" coef="1"/></fixed>' for _ in range(50_000)) + "</tendon>"),
        "overlapping geoms.xml": overlap(999),
        "too many overlapping geoms.xml": overlap(3900),
        "links.urdf": wide(250),
        "chains.urdf": comb(250),
        "many links.urdf": wide(20_000),
        "visuals.urdf": wide(3).replace("<inertial>", '<visual><geometry><sphere radius="1"/></geometry></visual>' * 19_000 + "<inertial>", 1),
        "attributes.urdf": "<robot name='r'><link " + " ".join(f'a{i}="1"' for i in range(100_000)) + "/></robot>",
    }


def bvhs():
    joint = "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Zrotation\n"
    root = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation\n"
    return {
        "deep": fill(root, joint),
        "frames": fill(root + "}\nMOTION\nFrames: 999999999\nFrame Time: 0.05\n", "0 0 0 0 0 0\n"),
        "one line": fill(root + "}\nMOTION\nFrames: 1\nFrame Time: 0.05\n", "0 "),
        "words": fill("HIERARCHY ", "a "),
        "lines": fill("HIERARCHY", "\n"),
        "channels": fill("HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 9999999 ", "Xrotation "),
    }


def lafans():
    row = ",".join(["0"] * 12)
    return {"rows": fill("", row + "\n"), "commas": fill("", ","), "lines": fill("", "\n"), "digits": fill("0,", "1")}


def npy(shape, data, descr="<f8"):
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"
    head += " " * (64 - (len(head) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + data


def npz(entries, most=None):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, head, zeros in entries:
            with archive.open(name, "w", force_zip64=True) as entry:
                entry.write(head)
                for _ in range(zeros // MB):
                    entry.write(bytes(MB))
    return out.getvalue()


def npzs():
    huge = "(99999999999, 5)"
    entries = io.BytesIO()
    with zipfile.ZipFile(entries, "w") as archive:
        for i in range(120_000):
            archive.writestr(f"{i}.npy", b"")
    return {
        "bomb": npz([("joint_pos.npy", npy("(100000, 5)", b""), 4096 * MB)]),
        "allowed bomb": npz([("joint_pos.npy", npy("(1600000, 5)", b""), 61 * MB)]),
        "claim": npz([("joint_pos.npy", npy(huge, bytes(80)), 0)]),
        "dimensions": npz([("joint_pos.npy", npy("(" + "1, " * 15_000 + ")", bytes(80)), 0)]),
        "nested header": npz([("joint_pos.npy", npy("(" * 30_000, bytes(80)), 0)]),
        "entries": entries.getvalue(),
    }


def record(op, body):
    return struct.pack("<BQ", op, len(body)) + body


def text(s):
    return struct.pack("<I", len(s)) + s


def chunk(packed, size, how=b""):
    return record(6, struct.pack("<QQQI", 0, 0, size, 0) + text(how) + struct.pack("<Q", len(packed)) + packed)


def mcaps():
    magic = b"\x89MCAP0\r\n"
    start = magic + record(1, text(b"") + text(b""))
    channel = record(4, struct.pack("<HH", 0, 0) + text(b"/joint_states") + text(b"cdr") + struct.pack("<I", 0))
    message = lambda data: record(5, struct.pack("<HIQQ", 0, 0, 0, 0) + data)
    bombs = b""
    if shutil.which("zstd"):
        packed = subprocess.run(["zstd", "-19", "-c"], input=bytes(63 * MB), capture_output=True, check=True).stdout
        bombs = chunk(packed, 63 * MB, b"zstd") * 1000
        plain = channel + message(bytes(4)) * 1_500_000
        messages = subprocess.run(["zstd", "-3", "-c"], input=plain, capture_output=True, check=True).stdout
    found = {
        "records": fill(start.decode("latin1"), record(2, b"").decode("latin1")).encode("latin1"),
        "messages": (start + channel + message(bytes(4)) * 400_000)[:MOST],
        "channels": (start + channel * 300_000)[:MOST],
        "claimed record": start + struct.pack("<BQ", 6, 1 << 60),
        "claimed chunk": start + chunk(bytes(100), 1 << 40),
        "claimed list": start + channel + message(struct.pack("<BBBBiII", 0, 1, 0, 0, 0, 0, 1 << 31)),
    }
    # A first message names 256 joints, and millions of others one each.
    def states(names):
        cdr = b"\0\1\0\0" + struct.pack("<II", 0, 0)
        strings = lambda texts: struct.pack("<I", len(texts)) + b"".join(struct.pack("<I", len(t) + 1) + t + b"\0" * (4 - len(t) % 4) for t in texts)
        cdr += struct.pack("<I", 1) + b"\0\0\0\0" + strings(names) + struct.pack("<I", len(names))
        cdr += b"\0" * (-(len(cdr) - 4) % 8) + bytes(8 * len(names))
        return cdr + struct.pack("<II", 0, 0)

    stamped = lambda n, data: record(5, struct.pack("<HIQQ", 0, n, n, n) + data)
    one = states([b"j0"])
    parts = b"".join(stamped(n, one) for n in range(1, 130_000))
    names = states([b"j%d" % j for j in range(256)])
    found["parts of states"] = start + channel + stamped(0, names) + parts
    found["channels and messages"] = start + channel * 100_000 + parts
    if shutil.which("zstd"):
        packed = subprocess.run(["zstd", "-3", "-c"], input=parts, capture_output=True, check=True).stdout
        packed = chunk(packed, len(parts), b"zstd")
        found["packed parts of states"] = start + channel + stamped(0, names) + packed * ((MOST - 20_000) // len(packed))
    if bombs:
        found["bombs"] = (start + bombs)[:MOST]
        found["packed messages"] = (start + chunk(messages, len(plain), b"zstd") * 8)[:MOST]
    return found


def journals():
    magic = b"robert-journal/2\n"
    return {
        "marks": (magic + b"\x00\xffRJ" * (4 * MB))[:MOST],
        "zeros": magic + bytes(MOST - 1000),
    }


def tensors():
    sized = lambda head, rest=b"": struct.pack("<Q", len(head)) + head + rest
    return {
        "claim": struct.pack("<Q", 99 << 20) + bytes(1000),
        "nested": sized(b"[" * (15 * MB)),
        "names": sized(b"{" + b",".join(b'"t%d":{"dtype":"F32","shape":[0],"data_offsets":[0,0]}' % i for i in range(250_000)) + b"}"),
        "shapes": sized(b'{"a":{"dtype":"F32","shape":[' + b"1," * (7 * MB) + b'1],"data_offsets":[0,4]}}', bytes(4)),
        "metadata": sized(b'{"__metadata__":{' + b",".join(b'"k%d":"v"' % i for i in range(900_000)) + b"}}"),
    }


def operations():
    return {
        "nested": fill("", "["),
        "batches": '{"op":"batch","args":{"label":"","ops":[' * 200_000,
        "scaled": json.dumps([{"op": "keys.add", "args": {"keys": [{"frame": i % 100, "q": [0, 0, 0, 0, 0]}], "replace": True}} for i in range(9_000)]),
    }


READERS = {
    "clip": (clips, ".clip.json", ["clip", "check", "FILE"]),
    "csv": (csvs, ".csv", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "ros": (yamls, ".yaml", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "json": (commands, ".json", ["clip", "convert", "--from", "json", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "mjcf": (xmls, ".xml", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "bvh": (bvhs, ".bvh", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "lafan": (lafans, ".lafan.csv", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e", "--fps", "30"]),
    "npz": (npzs, ".npz", ["clip", "convert", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "bag": (mcaps, ".mcap", ["clip", "convert", "--from", "bag", "FILE", "OUT.clip.json", "--robot", "ur5e"]),
    "take": (mcaps, ".mcap", ["export", "FILE", "--to", "csv", "-o", "OUT.csv"]),
    "model": (models, "", ["import", "FILE", "--out", "OUT", "--effort", "5"]),
    "policy": (tensors, ".safetensors", ["models", "show", "FILE"]),
    "operations": (operations, ".ops.json", ["clip", "apply", "a.clip.json", "FILE", "-o", "OUT.clip.json"]),
    "journal": (journals, "", ["studio", "--no-open", "--port", "0", "a.clip.json"]),
}


def cost(command, folder):
    """Exit code, last line, processor seconds and peak kilobytes, children included."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        os.dup2(write, 1)
        os.dup2(write, 2)
        os.environ.update(NO_COLOR="1", ROBERT_STATE_DIR=str(folder / "state"), XDG_CACHE_HOME=str(folder / "cache"))
        os.execv(command[0], command)
    os.close(write)
    said = b""
    while piece := os.read(read, 65536):
        said = (said + piece)[-2000:]
        if b"/#token=" in said:
            # A studio that is ready has read its journal.
            os.kill(pid, 15)
    os.close(read)
    _, status, usage = os.wait4(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    lines = said.decode(errors="replace").strip().splitlines() or [""]
    return code, lines[-1].split("/#token=")[0][:110], usage.ru_utime + usage.ru_stime, usage.ru_maxrss


def written(make, folder):
    """The shapes as files, made in a process of its own: a child begins with the memory of its parent."""
    shapes = folder / "shapes"
    pid = os.fork()
    if pid == 0:
        shapes.mkdir(exist_ok=True)
        for shape, content in make().items():
            (shapes / shape).write_bytes(content.encode() if isinstance(content, str) else content)
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0
    return sorted(shapes.iterdir())


def main(robert, *only):
    robert = str(pathlib.Path(robert).resolve())
    bad, shapes, worst = 0, 0, {}
    with tempfile.TemporaryDirectory(prefix="shapes-") as work:
        folder = pathlib.Path(work)
        # What any command costs, and what the largest robot costs.
        for name, (make, suffix, args) in READERS.items():
            if only and name not in only:
                continue
            for made in written(make, folder):
                shape, size = made.name, made.stat().st_size
                assert size <= MOST, (name, shape, size)
                path = folder / (shape.replace(" ", "_") + suffix)
                if name == "journal":
                    path = folder / "a.clip.json.autosave"
                (folder / "a.clip.json").write_text(clip('"keys":[{"frame":0,"q":[0,-1.5,1.5,-1.5,-1.5]}]', UR5E, 100, "ur5e"))
                made.rename(path)
                command = [robert] + [a.replace("FILE", path.name).replace("OUT", "out") for a in args]
                code, said, secs, kb = cost(command, folder)
                held = code in (0, 1, 3, -15) and secs <= SECS and kb <= KB
                bad += not held
                shapes += 1
                worst[name] = max(worst.get(name, (0, 0)), (secs, shape))
                print(f"{'ok  ' if held else 'FAIL'} {name}, {shape}: {size / MB:.1f} MB, exit {code}, {secs:.2f} s, {kb >> 10} MB: {said}", flush=True)
                path.unlink(missing_ok=True)
                for out in folder.glob("out*"):
                    shutil.rmtree(out) if out.is_dir() else out.unlink()
    print(f"{shapes} shapes, {bad} beyond {SECS:.0f} s or {KB >> 10} MB; the slowest: " + ", ".join(f"{n} {s:.2f} s ({w})" for n, (s, w) in worst.items()))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
