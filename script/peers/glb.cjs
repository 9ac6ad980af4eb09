// The Khronos validator and three.js on a GLB file: node glb.cjs FILE.glb POSES.json
// Needs the packages gltf-validator and three where NODE_PATH points.
const fs = require("fs");
const path = require("path");
const { createRequire } = require("module");
const validator = require("gltf-validator");

const [file, poses] = process.argv.slice(2);
const TOLERANCE = 1e-5; // m

// three.js is a module, which NODE_PATH does not reach: it is looked up beside the validator.
const beside = createRequire(require.resolve("gltf-validator"));
const three = (name) => import(path.join(path.dirname(beside.resolve("three")), "..", name));

async function main() {
  const bytes = new Uint8Array(fs.readFileSync(file));
  const { issues } = await validator.validateBytes(bytes, { maxIssues: 20 });
  for (const issue of issues.messages) console.log(JSON.stringify(issue));
  const THREE = await three("build/three.module.js");
  const { GLTFLoader } = await three("examples/jsm/loaders/GLTFLoader.js");
  global.self = global; // the loader asks for a window's names
  const gltf = await new Promise((done, fail) => new GLTFLoader().parse(bytes.buffer, "", done, fail));
  const wanted = JSON.parse(fs.readFileSync(poses, "utf8"));
  const mixer = new THREE.AnimationMixer(gltf.scene);
  if (gltf.animations.length) {
    // Repeated, the last frame would be the first one.
    const action = mixer.clipAction(gltf.animations[0]).setLoop(THREE.LoopOnce);
    action.clampWhenFinished = true;
    action.play();
  }
  let worst = 0;
  let count = 0;
  for (const [frame, places] of Object.entries(wanted.places)) {
    mixer.setTime(Number(frame) / wanted.fps);
    gltf.scene.updateMatrixWorld(true);
    wanted.bodies.forEach((body, i) => {
      const node = gltf.scene.getObjectByName(THREE.PropertyBinding.sanitizeNodeName(body));
      const at = new THREE.Vector3().setFromMatrixPosition(node.matrixWorld);
      const found = [at.x, -at.z, at.y]; // back from Y up
      found.forEach((v, k) => (worst = Math.max(worst, Math.abs(v - places[i][k]))));
      count += 1;
    });
  }
  const { numErrors, numWarnings, numInfos } = issues;
  console.log(`${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos; three.js: ${count} poses within ${worst.toExponential(1)} m`);
  process.exit(numErrors + numWarnings === 0 && worst < TOLERANCE ? 0 : 1);
}

main();
