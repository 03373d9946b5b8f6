// SPDX-License-Identifier: MIT
#include "pipedyn/vector/levels.hpp"

#include <atomic>
#include <cstdlib>
#include <stdexcept>

#include "pipedyn/vector/scratch.hpp"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#endif

namespace pipedyn {

namespace {

const std::vector<const MotionKernel*>& kernels() {
  static const std::vector<const MotionKernel*> found = [] {
    std::vector<const MotionKernel*> kernels{&motion_baseline};
#ifdef PIPEDYN_X86_LEVELS
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
      kernels.push_back(&motion_avx2);
      if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
          __builtin_cpu_supports("avx512vl")) {
        kernels.push_back(&motion_avx512);
      }
    }
#endif
    return kernels;
  }();
  return found;
}

const MotionKernel* named(const std::string& name) {
  std::string known;
  for (const MotionKernel* kernel : kernels()) {
    if (kernel->name == name) return kernel;
    known += (known.empty() ? "'" : ", '") + std::string(kernel->name) + "'";
  }
  throw std::invalid_argument("vector level must be one of " + known + ", got '" + name + "'");
}

std::atomic<const MotionKernel*>& current() {
  static std::atomic<const MotionKernel*> kernel = [] {
    const char* wish = std::getenv("PIPEDYN_VECTOR_LEVEL");
    return wish != nullptr && *wish != '\0' ? named(wish) : kernels().back();
  }();
  return kernel;
}

}  // namespace

std::vector<std::string> vector_levels() {
  std::vector<std::string> names;
  for (const MotionKernel* kernel : kernels()) names.emplace_back(kernel->name);
  return names;
}

std::string vector_level() { return motion_kernel().name; }

void set_vector_level(const std::string& name) { current() = named(name); }

const MotionKernel& motion_kernel() { return *current().load(std::memory_order_relaxed); }

double* scratch(std::ptrdiff_t count) {
  struct alignas(64) Line {
    double numbers[8];
  };
  thread_local std::vector<Line> kept(1);
  const std::size_t needed = static_cast<std::size_t>(count + 7) / 8;
  if (kept.size() < needed) kept = std::vector<Line>(needed);
#ifdef __SANITIZE_ADDRESS__  // so that access beyond these numbers is detected in a larger buffer
  __asan_poison_memory_region(kept.data(), kept.size() * sizeof(Line));
  __asan_unpoison_memory_region(kept.data(), static_cast<std::size_t>(count) * sizeof(double));
#endif
  return kept.data()->numbers;
}

}  // namespace pipedyn
