// SPDX-License-Identifier: MIT
// Bindings of the collocation of periodic orbits.
#include <pybind11/eigen.h>
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

/// The collocation method with s stages: nodes c (s,), and the matrices O (s, s) of first and T
/// (s, s) of second integrals, as in collocation.hpp.
using Weights = std::tuple<Numbers, Numbers, Numbers>;

GivenMatrix matrix(const char* name, const Numbers& values, Index rows, Index columns) {
  require_size(name, values, rows * columns);
  return {values.data(), rows, columns};
}

py::typing::Tuple<Numbers, Numbers> condense(const Numbers& durations, const Numbers& starts,
                                             const Numbers& rates, const Numbers& linearised,
                                             const std::optional<Numbers>& by_frequency,
                                             bool speed_varies, double frequency,
                                             const Weights& weights, double mirror_sign,
                                             const std::optional<Numbers>& units) {
  if (rates.ndim() != 3) {
    throw py::value_error("rates must have shape (M, s, n / 2), got " + shape_of(rates));
  }
  const auto& [nodes, single, twofold] = weights;
  const Index count = rates.shape(0), stages = rates.shape(1), half = rates.shape(2);
  const Index n = 2 * half, size = stages * half;
  const GivenMatrix none(nullptr, 0, 0);
  const Intervals intervals{
      .stages = stages,
      .half = half,
      .durations = matrix("durations", durations, count, 1),
      .starts = matrix("starts", starts, count, n),
      .rates = {rates.data(), count * stages, half},
      .linearised = matrix("linearised", linearised, count * stages * (2 + n), n),
      .by_frequency =
          by_frequency ? matrix("by_frequency", *by_frequency, half, count * stages) : none,
      .speed_varies = speed_varies,
      .frequency = frequency,
      .nodes = matrix("nodes", nodes, stages, 1),
      .single = matrix("single", single, stages, stages),
      .twofold = matrix("twofold", twofold, stages, stages),
      .mirror_sign = mirror_sign,
      .units = units ? matrix("units", *units, n, 1) : none,
  };
  Numbers by(std::vector<py::ssize_t>{count, size, n + 3});
  Numbers ends(std::vector<py::ssize_t>{count, n, n + 3});
  double* const to = by.mutable_data();
  double* const end = ends.mutable_data();
  const Lapack& lapack = scipy_lapack();
  std::atomic<bool> regular = true;
  {
    const py::gil_scoped_release unlocked;
    // A unit of work, some 5 ns (util/threads.hpp), is the time of 100 of an interval's products:
    // measured for n = 40, with stages of size 160.
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

py::typing::Tuple<Numbers, std::vector<Index>> map_products(const Numbers& maps, double most) {
  if (maps.ndim() != 3 || maps.shape(2) < maps.shape(1) || maps.shape(0) == 0) {
    throw py::value_error("maps must have shape (M, n, n + k), got " + shape_of(maps));
  }
  const Index count = maps.shape(0), n = maps.shape(1), columns = maps.shape(2);
  Numbers whole(std::vector<py::ssize_t>{count, n, columns});
  double* const to = whole.mutable_data();
  std::vector<Index> begins;
  {
    const py::gil_scoped_release unlocked;
    begins = multiply_maps(maps.data(), count, n, columns, most, to);
  }
  return py::make_tuple(whole, begins);
}

Numbers states_of(const Numbers& edges, const Numbers& starts, const Numbers& rates,
                  double frequency, double mirror_sign, const Numbers& single,
                  const Numbers& twofold, const Vector& phases) {
  const Index stages = single.size() / std::max<Index>(single.shape(0), 1);
  const Index count = edges.size() - 1, half = rates.size() / std::max<Index>(count * stages, 1);
  const Polynomials orbit{.edges = matrix("edges", edges, count + 1, 1),
                          .starts = matrix("starts", starts, count, 2 * half),
                          .rates = matrix("rates", rates, count * stages, half),
                          .frequency = frequency,
                          .mirror_sign = mirror_sign,
                          .single = matrix("single", single, stages + 1, stages),
                          .twofold = matrix("twofold", twofold, stages + 2, stages)};
  Numbers made = new_numbers(2 * half, phases.size(), false);
  double* const to = made.mutable_data();
  const py::gil_scoped_release unlocked;
  states_at(orbit, phases, {to, 2 * half, phases.size()});
  return made;
}

}  // namespace

void define_orbits(py::module_& m) {
  m.def("condense", &condense, "durations"_a, "starts"_a, "rates"_a, "linearised"_a,
        "by_frequency"_a, "speed_varies"_a, "frequency"_a, "weights"_a, "mirror_sign"_a = 1.0,
        "units"_a = py::none());
  m.def("map_products", &map_products, "maps"_a, "most"_a);
  m.def("orbit_states", &states_of, "edges"_a, "starts"_a, "rates"_a, "frequency"_a,
        "mirror_sign"_a, "single"_a, "twofold"_a, "phases"_a);
}

}  // namespace pipedyn
