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
  std::atomic<bool> regular = true;
  {
    const py::gil_scoped_release unlocked;
    // A unit of work, some 5 ns (util/threads.hpp), is the time of 100 of an interval's products:
    // measured for n = 40, with stages of size 160.
    in_parts(count, size * size * (size + n) / 100, [&](Index first, Index last) {
      Matrix system = stage_system(stages, half);
      for (Index m = first; m < last && regular; ++m) {
        const bool solved =
            eliminate_stages(intervals, m, system, {to + m * size * (n + 3), size, n + 3},
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

Numbers exponentials(const Numbers& exponents) {
  const py::ssize_t axes = exponents.ndim(), n = axes < 2 ? -1 : exponents.shape(axes - 1);
  if (n != (axes < 2 ? 0 : exponents.shape(axes - 2))) {
    throw py::value_error("exponents must have shape (..., n, n), got " + shape_of(exponents));
  }
  Numbers made(std::vector<py::ssize_t>(exponents.shape(), exponents.shape() + axes));
  double* const to = made.mutable_data();
  const py::gil_scoped_release unlocked;
  motion_kernel().exponentials(exponents.data(), n, exponents.size() / std::max<Index>(n * n, 1),
                               to);
  return made;
}

/// Maps of intervals of so many parts; the weights of the first part are in row begins of those of
/// all parts.
Numbers interval_maps(const Numbers& rows, const Numbers& durations,
                      const std::vector<Index>& parts, const std::vector<Index>& begins,
                      double unit, const Numbers& zeroth, const Numbers& first) {
  if (rows.ndim() != 4) {
    throw py::value_error("rows must have shape (M, s, n / 2, n), got " + shape_of(rows));
  }
  const Index count = rows.shape(0), stages = rows.shape(1), half = rows.shape(2);
  const Index n = 2 * half, each = stages * half * n;
  require_size("rows", rows, count * each);
  require_size("durations", durations, count);
  require_size("first", first, zeroth.size());
  Index most = 0;
  for (Index m = 0; m < count; ++m) {
    const std::size_t at = static_cast<std::size_t>(m);
    if (at >= std::min(parts.size(), begins.size()) || parts[at] < 1 || begins[at] < 0 ||
        (begins[at] + parts[at]) * stages > zeroth.size()) {
      throw py::value_error("each interval must have parts, and weights for them");
    }
    most = std::max(most, parts[at]);
  }
  Numbers made(std::vector<py::ssize_t>{count, n, n});
  double* const to = made.mutable_data();
  const double *const in_zeroth = zeroth.data(), *const in_first = first.data();
  const py::gil_scoped_release unlocked;
  // A unit of work, some 5 ns (util/threads.hpp), is the time of 100 of a product's operations; a
  // part takes some 10 products.
  in_parts(count, most * n * n * n / 5, [&](Index begin, Index end) {
    for (Index m = begin; m < end; ++m) {
      const std::size_t at = static_cast<std::size_t>(m);
      const Index row = begins[at] * stages;
      const MagnusInterval along{half,
                                 stages,
                                 parts[at],
                                 rows.data() + m * each,
                                 in_zeroth + row,
                                 in_first + row,
                                 durations.data()[m],
                                 unit};
      motion_kernel().interval_map(along, to + m * n * n);
    }
  });
  return made;
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
  m.def("exponentials", &exponentials, "exponents"_a);
  m.def("interval_maps", &interval_maps, "rows"_a, "durations"_a, "parts"_a, "begins"_a, "unit"_a,
        "zeroth"_a, "first"_a);
  m.def("orbit_states", &states_of, "edges"_a, "starts"_a, "rates"_a, "frequency"_a,
        "mirror_sign"_a, "single"_a, "twofold"_a, "phases"_a);
}

}  // namespace pipedyn
