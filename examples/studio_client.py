#!/usr/bin/env python3
"""Run with: python3 examples/studio_client.py [ADDRESS]    (standard library only)

Authors a clip in a running studio and waits for how near the policy came. ADDRESS is the line
that `robert studio` printed; without one a studio is started (`robert`, or what ROBERT_BIN names).
"""
import json, os, subprocess, sys, time, urllib.error, urllib.request

class Studio:
    """HTTP with the token as a Bearer header; see `robert::studio::protocol`."""

    def __init__(self, address):
        self.base, self.token = address.strip().split("/#token=")

    def ask(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        head = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(self.base + path, data, head, method=method)
        try:
            with urllib.request.urlopen(request) as answer:
                return json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as refusal:
            raise SystemExit(f"{path}: {json.loads(refusal.read())['message']}") from None

    def edit(self, label, *ops):
        """Ops are (name, arguments); together they are one entry of the history."""
        return self.ask("POST", "/api/ops", {"label": label, "ops": [{"op": o, "args": a} for o, a in ops]})

    def rolled_out(self, rev):
        while True:
            state = self.ask("GET", "/api/rollout")["state"]
            if state["rev"] == rev and state["phase"] == "failed":
                raise SystemExit(f"the rollout broke: {state['error']}")
            if state["rev"] == rev and state["phase"] == "done":
                return state
            time.sleep(0.05)

def main(studio):
    view = studio.ask("POST", "/api/new", {"robot": "ur5e", "length": 80, "name": "nod"})
    rest, names = view["table"]["rest"], view["clip"]["robot"]["joints"]
    bent = [q + (0.4 if name == "elbow" else 0.0) for name, q in zip(names, rest)]
    edited = studio.edit(
        "Nod",
        ("keys.add", {"keys": [{"frame": 25, "q": bent, "hold": 10}]}),  # its first key is where it rests
        ("keys.add", {"keys": [{"frame": 60, "q": rest, "hold": 20}]}),
    )
    state = studio.rolled_out(edited["rev"])
    print(f"{state['policy']}: {len(edited['lints'])} problems, mean error {state['mae']:.5f} rad")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Studio(sys.argv[1]))
    else:
        command = [os.environ.get("ROBERT_BIN", "robert"), "studio", "--no-open"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            try:
                main(Studio(child.stdout.readline()))
            finally:
                child.terminate()
