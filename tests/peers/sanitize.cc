// Runs broken models through the C++ shim under AddressSanitizer and UBSan. Not part of any
// build: script/sanitize compiles it together with src/mujoco/shim.cc and runs it.
//
//     sanitize ROUNDS FILE...
//
// Each file is loaded as it is and in ROUNDS damaged versions, each in a process of its own.
// Exits with 1 if a sanitizer reported anything in code that it sees (the shim and this file;
// libmujoco itself is not instrumented, and a crash within it is counted apart).
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "../../src/mujoco/shim.h"

// The program defines it in Rust.
extern "C" void rb_on_warning(const char*) {}

namespace {

constexpr int kReport = 99;  // exit code of a sanitizer's report
constexpr int kRefused = 2;
constexpr rlim_t kSeconds = 20;

uint64_t state;

uint64_t below(uint64_t n) {
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return n ? state % n : 0;
}

std::string damaged(std::string text, uint64_t seed) {
  state = 0x9e3779b97f4a7c15ull * (seed + 1);
  static const char* kWords[] = {"-1", "1e308", "nan", "1e9", "0", "\"", "<", "/>", "true", "mesh"};
  // Two thirds keep the XML whole and change numbers only: those reach the compiler.
  bool numbers = seed % 3;
  for (uint64_t n = 1 + below(6); n > 0 && !text.empty(); --n) {
    size_t at = below(text.size());
    if (numbers) {
      at = text.find_first_of("0123456789", at);
      if (at == std::string::npos) continue;
      static const char* kNumbers[] = {"-", "9", "0", "1e9", "1e-300", "e5", "99999"};
      if (below(2)) text[at] = static_cast<char>('0' + below(10));
      else text.insert(at, kNumbers[below(7)]);
      continue;
    }
    switch (below(5)) {
      case 0: text[at] = static_cast<char>(below(256)); break;
      case 1: text.erase(at, 1 + below(30)); break;
      case 2: text.insert(at, kWords[below(10)]); break;
      case 3: text.insert(at, text.substr(below(text.size()), below(60))); break;
      default: text.resize(at + 1); break;
    }
  }
  return text;
}

int drive(const std::string& path) {
  char msg[RB_MESSAGE] = "";
  mjModel* model = nullptr;
  if (rb_load_path(path.c_str(), &model, msg)) return kRefused;
  mjData* data = nullptr;
  mjData* copy = nullptr;
  mjModel* twin = nullptr;
  if (rb_make_data(model, &data, msg)) return kRefused;
  rb_forward(model, data, msg);
  rb_step(model, data, 20, msg);
  rb_kinematics(model, data, msg);
  rb_inverse(model, data, msg);
  std::vector<double> mass(static_cast<size_t>(model->nv) * model->nv + 1);
  rb_full_mass(model, data, mass.data(), msg);
  if (!rb_copy_model(model, &twin, msg) && !rb_make_data(twin, &copy, msg)) {
    rb_copy_data(copy, twin, data, msg);
    rb_reset(twin, copy, msg);
  }
  rb_delete_data(copy);
  rb_delete_data(data);
  rb_delete_model(twin);
  rb_delete_model(model);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  uint64_t rounds = std::strtoull(argv[1], nullptr, 10);
  int good = 0, refused = 0, reports = 0, crashes = 0, slow = 0;
  for (int f = 2; f < argc; ++f) {
    std::ifstream in(argv[f], std::ios::binary);
    std::string text((std::istreambuf_iterator<char>(in)), {});
    for (uint64_t round = 0; round <= rounds; ++round) {
      std::string path = argv[f];
      if (round) {
        // Beside the original, for its meshes and includes.
        path += ".damaged.xml";
        std::ofstream(path, std::ios::binary) << damaged(text, round * 1000 + f);
      }
      pid_t pid = fork();
      if (pid == 0) {
        rlimit cpu{kSeconds, kSeconds};
        setrlimit(RLIMIT_CPU, &cpu);
        freopen("/dev/null", "r", stdin);
        freopen("/dev/null", "w", stdout);
        std::exit(drive(path));
      }
      int status = 0;
      waitpid(pid, &status, 0);
      if (round) unlink(path.c_str());
      if (WIFSIGNALED(status)) {
        int sig = WTERMSIG(status);
        (sig == SIGXCPU || sig == SIGKILL ? slow : crashes)++;
        std::printf("%s, round %lu: signal %d\n", argv[f], static_cast<unsigned long>(round), sig);
      } else if (WEXITSTATUS(status) == kReport) {
        ++reports;
        std::printf("%s, round %lu: report\n", argv[f], static_cast<unsigned long>(round));
      } else {
        (WEXITSTATUS(status) == 0 ? good : refused)++;
      }
      std::fflush(stdout);
    }
  }
  std::printf("%d simulated, %d refused, %d reports, %d crashes in libmujoco, %d over %lu s\n", good,
              refused, reports, crashes, slow, static_cast<unsigned long>(kSeconds));
  return reports ? 1 : 0;
}
