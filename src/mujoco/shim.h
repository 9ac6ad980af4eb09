// Guarded entry points over libmujoco 2.2.2, one per thing the program does.
//
// MuJoCo reports a broken invariant through mju_error, whose default prints a prompt and
// waits for a key. Here a thread-local handler throws instead, and no C++ exception ever
// leaves an entry point: each returns a code and fills a message.

#pragma once
#include <mujoco/mujoco.h>

#ifdef __cplusplus
extern "C" {
#endif

// What an entry point returns.
enum RbCode {
  RB_OK = 0,       // done
  RB_ENGINE = 1,   // mju_error: the mjData is poisoned
  RB_MEMORY = 2,   // std::bad_alloc
  RB_CXX = 3,      // another C++ exception
  RB_UNKNOWN = 4,  // something else was thrown
  RB_REFUSED = 10, // the model does not compile; the message says why
  RB_ARGUMENT = 11 // an argument that MuJoCo would turn into an error or worse
};

// Length of every message buffer.
#define RB_MESSAGE 1024

// A file handed to the compiler in memory.
typedef struct RbAsset {
  const char* name;
  const void* bytes;
  int size;
} RbAsset;

int rb_version(void);
int rb_load_path(const char* path, mjModel** out, char* msg);
int rb_load_assets(const char* root, const RbAsset* assets, int count, mjModel** out, char* msg);
int rb_copy_model(const mjModel* m, mjModel** out, char* msg);
void rb_delete_model(mjModel* m);
int rb_set_const(mjModel* m, char* msg);

int rb_make_data(const mjModel* m, mjData** out, char* msg);
void rb_delete_data(mjData* d);
int rb_reset(const mjModel* m, mjData* d, char* msg);

int rb_step(const mjModel* m, mjData* d, int n, char* msg);
int rb_forward(const mjModel* m, mjData* d, char* msg);
int rb_kinematics(const mjModel* m, mjData* d, char* msg);
int rb_inverse(const mjModel* m, mjData* d, char* msg);
int rb_transition_fd(const mjModel* m, mjData* d, double eps, int centered, double* a, double* b,
                     char* msg);
int rb_full_mass(const mjModel* m, const mjData* d, double* dense, char* msg);
int rb_jac_site(const mjModel* m, const mjData* d, double* jacp, double* jacr, int site, char* msg);

const char* rb_name(const mjModel* m, int type, int id);
int rb_id(const mjModel* m, int type, const char* name);

// The yardstick of `bench sim`: the plainest loop a C program would write.
int rb_bare_loop(const mjModel* m, mjData* d, const double* ctrl, int control_steps, int substeps,
                 int reset_every, char* msg);

// Implemented in Rust: receives every warning of the engine.
void rb_on_warning(const char* msg);

#ifdef __cplusplus
}
#endif
