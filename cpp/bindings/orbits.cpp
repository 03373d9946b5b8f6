// SPDX-License-Identifier: MIT
// Bindings of the collocation of periodic orbits.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <optional>
#include <vector>

#include "arguments.hpp"
#include "pipedyn/motion/orbit.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// The collocation method with s stages: nodes c (s,), matrices O (s, s) and T (s, s).
using Weights = std::tuple<Numbers, Numbers, Numbers>;

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
  const py::ssize_t count = rates.shape(0), stages = rates.shape(1), half = rates.shape(2);
  const py::ssize_t n = 2 * half, all = rates.size();
  require_size("durations", durations, count);
  require_size("starts", starts, count * n);
  require_size("linearised", linearised, count * stages * (2 + n) * n);
  if (by_frequency) require_size("by_frequency", *by_frequency, all);
  require_size("nodes", nodes, stages);
  require_size("once", once, stages * stages);
  require_size("twice", twice, stages * stages);
  if (units) require_size("units", *units, n);
  Numbers by(std::vector<py::ssize_t>{count, stages * half, n + 3});
  Numbers ends(std::vector<py::ssize_t>{count, n, n + 3});
  const Intervals intervals{
      .count = count,
      .stages = stages,
      .half = half,
      .durations = durations.data(),
      .starts = starts.data(),
      .rates = rates.data(),
      .linearised = linearised.data(),
      .by_frequency = by_frequency ? by_frequency->data() : nullptr,
      .speed_varies = speed_varies,
      .frequency = frequency,
      .nodes = nodes.data(),
      .once = once.data(),
      .twice = twice.data(),
      .mirror = mirror,
      .units = units ? units->data() : nullptr,
  };
  double* const to = by.mutable_data();
  double* const end = ends.mutable_data();
  std::atomic<bool> regular = true;
  {
    const py::gil_scoped_release unlocked;
    const Index size = stages * half;
    in_parts(count, size * size * (size + n) / 100, [&](Index first, Index last) {
      std::vector<double*> rows(static_cast<std::size_t>(size));
      if (!motion_kernel().eliminate_stages(intervals, first, last, rows.data(), to, end)) {
        regular = false;
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

Numbers states_of(const Numbers& edges, const Numbers& starts, const Numbers& rates,
                  double frequency, double mirror, const Numbers& once, const Numbers& twice,
                  const Numbers& phases) {
  if (rates.ndim() != 3 || starts.ndim() != 2) {
    throw py::value_error("starts and rates must have shapes (M, n) and (M, s, n / 2), got " +
                          shape_of(starts) + " and " + shape_of(rates));
  }
  const py::ssize_t count = rates.shape(0), stages = rates.shape(1), half = rates.shape(2);
  require_size("edges", edges, count + 1);
  require_size("starts", starts, 2 * half * count);
  require_size("once", once, (stages + 1) * stages);
  require_size("twice", twice, (stages + 2) * stages);
  const Polynomials orbit{count,        stages,    half,   edges.data(), starts.data(),
                          rates.data(), frequency, mirror, once.data(),  twice.data()};
  Numbers made = new_numbers(2 * half, phases.size(), false);
  double* const to = made.mutable_data();
  const py::gil_scoped_release unlocked;
  states_at(orbit, phases.data(), phases.size(), to);
  return made;
}

}  // namespace

void define_orbits(py::module_& m) {
  m.def("eliminated", &eliminated, "durations"_a, "starts"_a, "rates"_a, "linearised"_a,
        "by_frequency"_a, "speed_varies"_a, "frequency"_a, "weights"_a, "mirror"_a = 1.0,
        "units"_a = py::none());
  m.def("carried", &carried, "maps"_a, "most"_a);
  m.def("orbit_states", &states_of, "edges"_a, "starts"_a, "rates"_a, "frequency"_a, "mirror"_a,
        "once"_a, "twice"_a, "phases"_a);
}

}  // namespace pipedyn
