// MuJoCo's own reading of a model, for comparison with an imported robot.
//
//   kinematics MODEL < poses
//
// Input: a line "njoint nposes", the joint names, then a line of joint values for each pose.
// Output: "nq N", then for each body "body ID mass x y z (centre of mass)", then for each pose
// and body "pose K ID x y z qw qx qy qz". Joints are set by name.

#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>

#define MAX_JOINTS 512

int main(int argc, char** argv) {
  char error[1000] = "";
  mjModel* m = argc == 2 ? mj_loadXML(argv[1], NULL, error, sizeof error) : NULL;
  if (!m) {
    fprintf(stderr, "%s\n", error);
    return 3;
  }
  int njoint, nposes, address[MAX_JOINTS];
  char name[1024];
  if (scanf("%d %d", &njoint, &nposes) != 2 || njoint > MAX_JOINTS) return 1;
  for (int j = 0; j < njoint; j++) {
    if (scanf(" %1000[^\n]", name) != 1) return 1;
    int id = mj_name2id(m, mjOBJ_JOINT, name);
    address[j] = id < 0 ? -1 : m->jnt_qposadr[id];
    if (id < 0) fprintf(stderr, "no joint %s\n", name);
  }
  printf("nq %d\n", m->nq);
  for (int b = 1; b < m->nbody; b++) {
    mjtNum* p = m->body_ipos + 3 * b;
    printf("body %d %.17g %.17g %.17g %.17g\n", b, m->body_mass[b], p[0], p[1], p[2]);
  }
  mjData* d = mj_makeData(m);
  for (int k = 0; k < nposes; k++) {
    mj_resetData(m, d);
    for (int j = 0; j < njoint; j++) {
      double q;
      if (scanf("%lf", &q) != 1) return 1;
      if (address[j] >= 0) d->qpos[address[j]] = q;
    }
    mj_kinematics(m, d);
    for (int b = 1; b < m->nbody; b++) {
      mjtNum *x = d->xpos + 3 * b, *q = d->xquat + 4 * b;
      printf("pose %d %d %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", k, b, x[0],
             x[1], x[2], q[0], q[1], q[2], q[3]);
    }
  }
  return 0;
}
