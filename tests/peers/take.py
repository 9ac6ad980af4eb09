#!/usr/bin/env python3
"""Opens takes with the public readers. On demand, not in CI:

    python3 -m venv VENV
    VENV/bin/pip install mcap mcap-ros2-support mcap-protobuf-support rerun-sdk
    VENV/bin/python tests/peers/take.py target/release/robert

Every message is decoded by schemas inside the file and compared with `robert export --to
json` of the same take. Where rerun-sdk is there, its converter must load the file, too.
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

robert = str(pathlib.Path(sys.argv[1]).resolve())
clips = sys.argv[2:] or ["ur5e/reacher", "ur5e/hang_high_mask"]


def near(a, b, what, by=1e-12):
    assert len(a) == len(b), f"{what}: {len(a)} values, not {len(b)}"
    assert all(abs(x - y) < by for x, y in zip(a, b)), f"{what}: {a} {b}"


def check(clip, folder):
    path = folder / "take.mcap"
    subprocess.run([robert, "-q", "rollout", clip, "--policy", "pd", "--out", path], check=True,
                   stdout=subprocess.DEVNULL)
    want = json.loads(subprocess.run([robert, "-q", "export", path, "--to", "json"], check=True,
                                     capture_output=True).stdout)
    joints = want["robot"]["joints"]
    count = {}
    seen = []
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[Ros2(), Protobuf()])
        assert reader.get_header().profile == ""
        for schema, channel, message, data in reader.iter_decoded_messages():
            count[channel.topic] = count.get(channel.topic, 0) + 1
            frame = round((message.log_time / 1e9 - 1767225600) * 20)
            if channel.topic == "/joint_states":
                assert schema.name == "sensor_msgs/msg/JointState"
                row = want["achieved"][frame]
                assert list(data.name) == joints
                near(data.position, row["position"], "position")
                near(data.velocity, row["velocity"], "velocity")
                near(data.effort, row.get("effort", []), "effort")
                assert data.header.stamp.sec * 10**9 + data.header.stamp.nanosec == message.log_time
            elif channel.topic == "/command/joint_states":
                row = want["command"][frame]
                names = ["cmd/" + j for j, v in zip(joints, row) if v is not None]
                assert list(data.name) == names
                near(data.position, [v for v in row if v is not None], "command", 1e-6)
                seen.append(frame)
            elif channel.topic == "/command/trajectory":
                assert list(data.joint_names) == joints
                full = [f for f, r in enumerate(want["command"]) if None not in r]
                assert len(data.points) == len(full)
                for f, point in zip(full, data.points):
                    near(point.positions, want["command"][f], "trajectory", 1e-6)
                    stamp = point.time_from_start
                    assert stamp.sec * 20 + stamp.nanosec // 50_000_000 == f
            elif channel.topic in ("/tf", "/command/tf"):
                prefix = "cmd/" if channel.topic == "/command/tf" else ""
                names = [t.child_frame_id for t in data.transforms]
                assert names == [prefix + b for b in want["robot"]["bodies"]]
                for t in data.transforms:
                    q = t.rotation
                    assert abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1) < 1e-9
                    assert t.parent_frame_id == "world"
            elif channel.topic == "/scene":
                assert {e.frame_id.removeprefix("cmd/") for e in data.entities} <= {
                    "world", *want["robot"]["bodies"]}
                assert all(e.frame_locked for e in data.entities)
                assert sum(len(e.triangles) + len(e.cubes) + len(e.spheres) + len(e.cylinders)
                           for e in data.entities) > 0
            elif channel.topic == "/robert/metrics":
                assert data.frame == frame
                error = want["achieved"][frame]["error"]
                assert data.HasField("frame_mae") != data.masked
                if frame > 0 and error is not None:
                    near([data.frame_mae], [error], "frame_mae")
                near(data.action, want["achieved"][frame].get("action", []), "action")
            elif channel.topic == "/log":
                assert data.level in (2, 3) and data.message
            else:
                raise AssertionError(channel.topic)
        attachments = {a.name: a for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert sorted(attachments) == ["clip.json", "config.toml", "take.json"]
    config = tomllib.loads(attachments["config.toml"].data.decode())
    assert config["policy"]["name"] == metadata["robert"]["policy"] == "pd"
    assert config["rollout"]["seed"] == int(metadata["robert"]["seed"])
    assert json.loads(attachments["clip.json"].data)["format"] == "robert-clip/1"
    assert json.loads(attachments["take.json"].data)["format"] == "robert-take/1"
    assert metadata["robert"]["format"] == "robert-take/1"
    assert float(metadata["robert"]["precision"]) == want["precision"]["precision"]
    assert count["/joint_states"] == count["/tf"] == count["/robert/metrics"] == want["frames"]
    assert seen == [f for f, r in enumerate(want["command"]) if any(v is not None for v in r)]
    with open(path, "rb") as stream:
        records = sum(1 for _ in StreamReader(stream, validate_crcs=True).records)
    print(f"{clip}: {path.stat().st_size} bytes, {want['frames']} frames, {records} records,"
          f" {sum(count.values())} messages", count)
    return path


def rerun(path, folder):
    rrd = folder / "take.rrd"
    command = [pathlib.Path(sys.executable).with_name("rerun"), "mcap", "convert", path, "-o", rrd]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    print("  rerun mcap convert:", rrd.stat().st_size, "bytes", done.stderr.strip()[-300:])
    stats = [pathlib.Path(sys.executable).with_name("rerun"), "rrd", "print", rrd]
    text = subprocess.run(stats, capture_output=True, text=True)
    lines = text.stdout + text.stderr
    for entity in ["/joint_states", "/tf", "/robert/metrics"]:
        assert entity in lines, f"{entity} is not in the recording:\n{lines[:2000]}"


with tempfile.TemporaryDirectory() as temp:
    for clip in clips:
        folder = pathlib.Path(temp)
        path = check(clip, folder)
        if pathlib.Path(sys.executable).with_name("rerun").exists():
            rerun(path, folder)
print("ok")
