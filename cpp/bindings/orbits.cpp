// SPDX-License-Identifier: MIT
// Bindings of the collocation of periodic orbits.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <optional>
#include <vector>

#include "arguments.hpp"
#include "pipedyn/motion/collocation.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// The collocation method with s stages: nodes c (s,), matrices O (s, s) and T (s, s).
using Weights = std::tuple<Numbers, Numbers, Numbers>;

Intervals::Table table(const char* name, const Numbers& of, Index rows, Index columns) {
  require_size(name, of, rows * columns);
  return {of.data(), rows, columns};
}

py::typing::Tuple<Numbers, Numbers> eliminated(const Numbers& durations, const Numbers& starts,
                                               const Numbers& rates, const Numbers& linearised,
                                               const std::optional<Numbers>& by_frequency,
                                               bool speed_varies, double frequency,
                                               const Weights& weights, double mirror,
                                               const std::optional<Numbers>& units) {
  if (rates.ndim() != 3) {
    throw py::value_error("rates must have shape (M, s, n / 2), got " + shape_of(rates));
  }
  const auto& [nodes, once, twice] = weights;
  const Index count = rates.shape(0), stages = rates.shape(1), half = rates.shape(2);
  const Index n = 2 * half, size = stages * half;
  const Intervals::Table none(nullptr, 0, 0);
  const Intervals intervals{
      .stages = stages,
      .half = half,
      .durations = table("durations", durations, count, 1),
      .starts = table("starts", starts, count, n),
      .rates = {rates.data(), count * stages, half},
      .linearised = table("linearised", linearised, count * stages * (2 + n), n),
      .by_frequency =
          by_frequency ? table("by_frequency", *by_frequency, half, count * stages) : none,
      .speed_varies = speed_varies,
      .frequency = frequency,
      .nodes = table("nodes", nodes, stages, 1),
      .once = table("once", once, stages, stages),
      .twice = table("twice", twice, stages, stages),
      .mirror = mirror,
      .units = units ? table("units", *units, n, 1) : none,
  };
  Numbers by(std::vector<py::ssize_t>{count, size, n + 3});
  Numbers ends(std::vector<py::ssize_t>{count, n, n + 3});
  double* const to = by.mutable_data();
  double* const end = ends.mutable_data();
  const Lapack& lapack = scipy_lapack();
  std::atomic<bool> regular = true;
  {
    const py::gil_scoped_release unlocked;
    in_parts(count, size * size * (size + n) / 100, [&](Index first, Index last) {
      for (Index m = first; m < last && regular; ++m) {
        const bool solved =
            eliminate_stages(lapack, intervals, m, {to + m * size * (n + 3), size, n + 3},
                             {end + m * n * (n + 3), n, n + 3});
        if (!solved) regular = false;
      }
    });
  }
  if (!regular) {
    const py::object error = py::module_::import("numpy.linalg").attr("LinAlgError");
    PyErr_SetString(error.ptr(), "Singular matrix");
    throw py::error_already_set();
  }
  return py::make_tuple(by, ends);
}

}  // namespace

void define_orbits(py::module_& m) {
  m.def("eliminated", &eliminated, "durations"_a, "starts"_a, "rates"_a, "linearised"_a,
        "by_frequency"_a, "speed_varies"_a, "frequency"_a, "weights"_a, "mirror"_a = 1.0,
        "units"_a = py::none());
}

}  // namespace pipedyn
