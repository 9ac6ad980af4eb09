// See shim.h. Compiled by build.rs against the installed MuJoCo headers.

#include "shim.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <new>

static_assert(mjVERSION_HEADER == 222, "src/mujoco is written for MuJoCo 2.2.2 (mjVERSION_HEADER 222)");
static_assert(sizeof(mjModel) == 3280, "mjModel has another layout than bindings.rs");
static_assert(sizeof(mjData) == 41176, "mjData has another layout than bindings.rs");
static_assert(sizeof(mjOption) == 240, "mjOption has another layout than bindings.rs");
static_assert(sizeof(mjContact) == 528, "mjContact has another layout than bindings.rs");
static_assert(sizeof(mjtNum) == 8, "MuJoCo was built for single precision");

// Exported by the library, declared in no header: they take precedence over the
// process-wide mju_user_error and are the only handlers that are safe with threads.
extern "C" {
typedef void (*rb_hook)(const char*);
void _mjPRIVATE__set_tls_error_fn(rb_hook);
rb_hook _mjPRIVATE__get_tls_error_fn(void);
void _mjPRIVATE__set_tls_warning_fn(rb_hook);
rb_hook _mjPRIVATE__get_tls_warning_fn(void);
}

namespace {

struct EngineError {
  char text[RB_MESSAGE];
};

void throw_error(const char* text) {
  EngineError e;
  std::snprintf(e.text, sizeof e.text, "%s", text ? text : "unknown engine error");
  throw e;
}

// Installs both handlers for one call and puts back what was there on every way out.
struct Hooks {
  rb_hook error = _mjPRIVATE__get_tls_error_fn();
  rb_hook warning = _mjPRIVATE__get_tls_warning_fn();
  Hooks() {
    _mjPRIVATE__set_tls_error_fn(throw_error);
    _mjPRIVATE__set_tls_warning_fn(rb_on_warning);
  }
  ~Hooks() {
    _mjPRIVATE__set_tls_error_fn(error);
    _mjPRIVATE__set_tls_warning_fn(warning);
  }
};

void say(char* msg, const char* text) {
  if (msg) std::snprintf(msg, RB_MESSAGE, "%s", text);
}

template <class F>
int guard(char* msg, F body) noexcept {
  Hooks hooks;
  if (msg) msg[0] = 0;
  try {
    return body();
  } catch (const EngineError& e) {
    say(msg, e.text);
    return RB_ENGINE;
  } catch (const std::bad_alloc&) {
    say(msg, "out of memory");
    return RB_MEMORY;
  } catch (const std::exception& e) {
    say(msg, e.what());
    return RB_CXX;
  } catch (...) {
    say(msg, "unknown exception");
    return RB_UNKNOWN;
  }
}

// mjVFS is 2 MB: heap only, and always emptied.
struct Vfs {
  mjVFS* files = static_cast<mjVFS*>(std::calloc(1, sizeof(mjVFS)));
  Vfs() {
    if (!files) throw std::bad_alloc();
    mj_defaultVFS(files);
  }
  ~Vfs() {
    mj_deleteVFS(files);
    std::free(files);
  }
  Vfs(const Vfs&) = delete;
  Vfs& operator=(const Vfs&) = delete;
};

int loaded(mjModel* m, mjModel** out, char* msg) {
  *out = m;
  if (m) return RB_OK;  // msg may hold a compiler warning
  if (msg && !msg[0]) say(msg, "the model was refused without a reason");
  return RB_REFUSED;
}

}  // namespace

extern "C" {

int rb_version(void) { return mj_version(); }

int rb_load_path(const char* path, mjModel** out, char* msg) {
  *out = nullptr;
  return guard(msg, [&] { return loaded(mj_loadXML(path, nullptr, msg, RB_MESSAGE), out, msg); });
}

int rb_load_assets(const char* root, const RbAsset* assets, int count, mjModel** out, char* msg) {
  *out = nullptr;
  return guard(msg, [&]() -> int {
    Vfs vfs;
    for (int i = 0; i < count; i++) {
      const RbAsset& a = assets[i];
      if (a.size <= 0 || !a.name[0] || std::strlen(a.name) >= mjMAXVFSNAME) {
        say(msg, "an asset is empty or its name too long");
        return RB_ARGUMENT;
      }
      int rc = mj_makeEmptyFileVFS(vfs.files, a.name, a.size);
      if (rc != 0) {
        say(msg, rc == 2 ? "two assets share one file name (names are compared without folder and case)"
                         : "too many assets");
        return RB_ARGUMENT;
      }
      int at = mj_findFileVFS(vfs.files, a.name);
      if (at < 0) return RB_ARGUMENT;
      std::memcpy(vfs.files->filedata[at], a.bytes, static_cast<size_t>(a.size));
    }
    return loaded(mj_loadXML(root, vfs.files, msg, RB_MESSAGE), out, msg);
  });
}

int rb_copy_model(const mjModel* m, mjModel** out, char* msg) {
  *out = nullptr;
  return guard(msg, [&] {
    *out = mj_copyModel(nullptr, m);
    return *out ? RB_OK : RB_MEMORY;
  });
}

void rb_delete_model(mjModel* m) {
  guard(nullptr, [&] { mj_deleteModel(m); return RB_OK; });
}

int rb_set_const(mjModel* m, char* msg) {
  return guard(msg, [&] {
    std::unique_ptr<mjData, void (*)(mjData*)> d(mj_makeData(m), mj_deleteData);
    if (!d) return RB_MEMORY;
    mj_setConst(m, d.get());
    return RB_OK;
  });
}

int rb_make_data(const mjModel* m, mjData** out, char* msg) {
  *out = nullptr;
  return guard(msg, [&] {
    *out = mj_makeData(m);
    return *out ? RB_OK : RB_MEMORY;
  });
}

void rb_delete_data(mjData* d) {
  guard(nullptr, [&] { mj_deleteData(d); return RB_OK; });
}

int rb_reset(const mjModel* m, mjData* d, char* msg) {
  return guard(msg, [&] {
    mj_resetData(m, d);
    // mj_resetData keeps the diagnostics of the life before.
    std::memset(d->warning, 0, sizeof d->warning);
    d->pstack = 0;
    return RB_OK;
  });
}

int rb_step(const mjModel* m, mjData* d, int n, char* msg) {
  return guard(msg, [&] {
    for (int i = 0; i < n; i++) mj_step(m, d);
    return RB_OK;
  });
}

int rb_forward(const mjModel* m, mjData* d, char* msg) {
  return guard(msg, [&] { mj_forward(m, d); return RB_OK; });
}

int rb_kinematics(const mjModel* m, mjData* d, char* msg) {
  return guard(msg, [&] {
    mj_kinematics(m, d);
    mj_comPos(m, d);
    return RB_OK;
  });
}

int rb_inverse(const mjModel* m, mjData* d, char* msg) {
  return guard(msg, [&] { mj_inverse(m, d); return RB_OK; });
}

int rb_transition_fd(const mjModel* m, mjData* d, double eps, int centered, double* a, double* b,
                     char* msg) {
  return guard(msg, [&] {
    mjd_transitionFD(m, d, eps, static_cast<mjtByte>(centered), a, b, nullptr, nullptr);
    return RB_OK;
  });
}

int rb_full_mass(const mjModel* m, const mjData* d, double* dense, char* msg) {
  return guard(msg, [&] { mj_fullM(m, dense, d->qM); return RB_OK; });
}

int rb_jac_site(const mjModel* m, const mjData* d, double* jacp, double* jacr, int site, char* msg) {
  return guard(msg, [&] { mj_jacSite(m, d, jacp, jacr, site); return RB_OK; });
}

const char* rb_name(const mjModel* m, int type, int id) { return mj_id2name(m, type, id); }

int rb_id(const mjModel* m, int type, const char* name) { return mj_name2id(m, type, name); }

int rb_bare_loop(const mjModel* m, mjData* d, const double* ctrl, int control_steps, int substeps,
                 int reset_every, char* msg) {
  return guard(msg, [&] {
    const int nu = m->nu;
    for (int i = 0; i < control_steps; i++) {
      if (i % reset_every == 0) mj_resetData(m, d);
      std::memcpy(d->ctrl, ctrl + static_cast<size_t>(i % reset_every) * nu, sizeof(double) * nu);
      for (int k = 0; k < substeps; k++) mj_step(m, d);
    }
    return RB_OK;
  });
}

}  // extern "C"
