// SPDX-License-Identifier: MIT
// Bindings of the collocation of periodic orbits.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <vector>

#include "arguments.hpp"
#include "pipedyn/motion/orbit.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

Numbers stage_changes(const Numbers& durations, const Numbers& linearised, const Numbers& once,
                      const Numbers& twice, const Numbers& right) {
  if (once.ndim() != 2 || right.ndim() != 3 || once.shape(0) == 0) {
    throw py::value_error("once and right must have shapes (s, s) and (M, s n / 2, k), got " +
                          shape_of(once) + " and " + shape_of(right));
  }
  const py::ssize_t stages = once.shape(0), count = right.shape(0), size = right.shape(1);
  const py::ssize_t half = size / stages, n = 2 * half;
  require_size("durations", durations, count);
  require_size("linearised", linearised, count * stages * (2 + n) * n);
  require_size("once", once, stages * stages);
  require_size("twice", twice, stages * stages);
  require_size("right", right, count * stages * half * right.shape(2));
  Numbers made(std::vector<py::ssize_t>{count, size, right.shape(2)});
  const Intervals intervals{
      .count = count,
      .stages = stages,
      .half = half,
      .durations = durations.data(),
      .linearised = linearised.data(),
      .once = once.data(),
      .twice = twice.data(),
      .columns = right.shape(2),
      .right = right.data(),
  };
  double* const to = made.mutable_data();
  std::atomic<bool> regular = true;
  {
    const py::gil_scoped_release unlocked;
    in_parts(count, size * size * (size + n) / 100, [&](Index first, Index last) {
      std::vector<double*> rows(static_cast<std::size_t>(size));
      if (!motion_kernel().solve_stages(intervals, first, last, rows.data(), to)) regular = false;
    });
  }
  if (!regular) {
    const py::object error = py::module_::import("numpy.linalg").attr("LinAlgError");
    PyErr_SetString(error.ptr(), "Singular matrix");
    throw py::error_already_set();
  }
  return made;
}

py::typing::Tuple<Numbers, std::vector<py::ssize_t>> carried(const Numbers& maps, double most) {
  if (maps.ndim() != 3 || maps.shape(2) < maps.shape(1) || maps.shape(0) == 0) {
    throw py::value_error("maps must have shape (M, n, n + k), got " + shape_of(maps));
  }
  const py::ssize_t count = maps.shape(0), n = maps.shape(1), columns = maps.shape(2);
  Numbers whole(std::vector<py::ssize_t>{count, n, columns});
  double* const to = whole.mutable_data();
  std::vector<py::ssize_t> begins;
  {
    const py::gil_scoped_release unlocked;
    begins = carry_maps(maps.data(), count, n, columns, most, to);
  }
  return py::make_tuple(whole, begins);
}

}  // namespace

void define_orbits(py::module_& m) {
  m.def("stage_changes", &stage_changes, "durations"_a, "linearised"_a, "once"_a, "twice"_a,
        "right"_a);
  m.def("carried", &carried, "maps"_a, "most"_a);
}

}  // namespace pipedyn
