// SPDX-License-Identifier: MIT
// Bindings of the collocation of periodic orbits.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <optional>
#include <vector>

#include "arguments.hpp"
#include "models.hpp"
#include "pipedyn/motion/collocation.hpp"
#include "pipedyn/util/nearest.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// The collocation method with s stages: nodes c (s,), and the transposes (s, s) of the matrices O
/// of first and T of second integrals, as in collocation.hpp.
using Method = std::tuple<Numbers, Numbers, Numbers>;

GivenMatrix matrix(const char* name, const Numbers& values, Index rows, Index columns) {
  require_size(name, values, rows * columns);
  return {values.data(), rows, columns};
}

Intervals intervals_of(const Numbers& durations, const Numbers& starts, const Numbers& rates,
                       const Method& method, double frequency = 1.0, double mirror_sign = 1.0) {
  if (rates.ndim() != 3 || rates.size() == 0) {
    throw py::value_error("rates must have shape (M, s, n / 2), got " + shape_of(rates));
  }
  const auto& [nodes, single, twofold] = method;
  const Index count = rates.shape(0), stages = rates.shape(1), half = rates.shape(2);
  return {.weights = {matrix("nodes", nodes, stages, 1), matrix("single", single, stages, stages),
                      matrix("twofold", twofold, stages, stages)},
          .durations = matrix("durations", durations, count, 1),
          .starts = matrix("starts", starts, count, 2 * half),
          .rates = {rates.data(), count * stages, half},
          .frequency = frequency,
          .mirror_sign = mirror_sign};
}

[[noreturn]] void refuse_singular() {
  const py::object error = py::module_::import("numpy.linalg").attr("LinAlgError");
  PyErr_SetString(error.ptr(), "Singular matrix");
  throw py::error_already_set();
}

/// States at both ends of a span (2 n, k) with the loads (so many, k), checked.
void require_ends(const Matrix& ends, const Matrix& loads, Index n, Index of_loads) {
  if (ends.rows() == 2 * n && loads.rows() == of_loads && loads.cols() == ends.cols()) return;
  throw py::value_error("ends and loads must have " + std::to_string(2 * n) + " and " +
                        std::to_string(of_loads) + " rows, and as many columns");
}

/// The rows of a matrix as those of `count` matrices.
Numbers stacked(const Matrix& rows, Index count) {
  const std::vector<py::ssize_t> shape{count, rows.rows() / std::max<Index>(count, 1), rows.cols()};
  return Numbers(shape, rows.data());
}

LinearisedOrbit linearised_orbit(const py::object& model, const Numbers& durations,
                                 const Numbers& starts, const Numbers& rates, const Method& method,
                                 double frequency, double mirror_sign, const Vector& speeds,
                                 const std::optional<Matrix>& drive,
                                 const std::optional<Numbers>& by_frequency, bool speed_varies,
                                 bool of_states, bool forced, double most) {
  const Intervals of = intervals_of(durations, starts, rates, method, frequency, mirror_sign);
  const Index stages = of.count() * of.stages(), half = of.half();
  Forces forces{
      .linearise = {},
      .speeds = speeds,
      .drive = drive.value_or(Matrix()),
      .by_frequency = by_frequency ? matrix("by_frequency", *by_frequency, half, stages)
                                   : GivenMatrix(nullptr, 0, 0),
      .speed_varies = speed_varies,
      .of_states = of_states,
      .forced = forced,
  };
  if ((speeds.size() != 1 && speeds.size() != stages) ||
      (drive && (drive->rows() < Drive::rows || drive->cols() != stages))) {
    throw py::value_error("speeds and drive must be those at " + std::to_string(stages) +
                          " stages");
  }
  with_compiled(model, [&]<class Model>(const Model& compiled) {
    if (compiled.dof() != half) throw py::value_error("rates must be those of the model");
    forces.linearise = [&compiled, of_states](const Batch& batch, double* out) {
      of_states ? compiled.jacobian(batch, out) : compiled.linearise(batch, out);
    };
  });
  std::optional<LinearisedOrbit> made;
  {
    const py::gil_scoped_release unlocked;
    made.emplace(of, forces, most);
  }
  if (!made->regular) refuse_singular();
  return *std::move(made);
}

Numbers stage_states(const Numbers& durations, const Numbers& starts, const Numbers& rates,
                     const Method& method) {
  const Intervals of = intervals_of(durations, starts, rates, method);
  const Index rows = 2 * of.half(), columns = of.count() * of.stages();
  Numbers made = new_numbers(rows, columns, false);
  Eigen::Map<Matrix> states(made.mutable_data(), rows, columns);
  for (Index m = 0; m < of.count(); ++m) {
    states_at_stages(of, m, states.middleCols(m * of.stages(), of.stages()));
  }
  return made;
}

SpanRelation span_relation(const Numbers& maps, double most) {
  if (maps.ndim() != 3 || maps.shape(2) < maps.shape(1) || maps.shape(0) == 0) {
    throw py::value_error("maps must have shape (M, n, n + k), got " + shape_of(maps));
  }
  const Index n = maps.shape(1), columns = maps.shape(2);
  const py::gil_scoped_release unlocked;
  return {GivenMatrix(maps.data(), maps.shape(0) * n, columns), n, most};
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
  if (edges.size() < 2) throw py::value_error("edges must hold 2 numbers or more");
  const Index count = edges.size() - 1, half = rates.size() / std::max<Index>(count * stages, 1);
  const OrbitPolynomials orbit{
      .count = count,
      .half = half,
      .stages = stages,
      .edges = edges.data(),
      .starts = matrix("starts", starts, count, 2 * half).data(),
      .rates = matrix("rates", rates, count * stages, half).data(),
      .frequency = frequency,
      .mirror_sign = mirror_sign,
      .single = matrix("single", single, stages + 1, stages).data(),
      .twofold = matrix("twofold", twofold, stages + 2, stages).data(),
  };
  Numbers made = new_numbers(2 * half, phases.size(), false);
  double* const to = made.mutable_data();
  const py::gil_scoped_release unlocked;
  motion_kernel().orbit_states(orbit, phases.data(), phases.size(), to);
  return made;
}

auto nearest_points(const NearestPoint& points, const Numbers& states, double most) {
  const Index n = points.size();
  if (states.ndim() != 2 || states.shape(1) != n) {
    throw py::value_error("states must have shape (k, " + std::to_string(n) + "), got " +
                          shape_of(states));
  }
  Numbers away = new_numbers(states.shape(0), n, false);
  py::array_t<Index> near(states.shape(0));
  double* const differences = away.mutable_data();
  Index* const numbers = near.mutable_data();
  const py::gil_scoped_release unlocked;
  for (Index k = 0; k < near.size(); ++k) {
    numbers[k] = points(states.data() + k * n, most, differences + k * n);
  }
  return std::pair(std::move(away), std::move(near));
}

}  // namespace

void define_orbits(py::module_& m) {
  py::class_<SpanRelation>(m, "SpanRelation")
      .def(py::init(&span_relation), "maps"_a, "most"_a)
      .def_readonly("first", &SpanRelation::first)
      .def_readonly("last", &SpanRelation::last)
      .def_readonly("known", &SpanRelation::known)
      .def_property_readonly("begins", &SpanRelation::begins)
      .def_property_readonly("products",
                             [](const SpanRelation& of) {
                               return stacked(
                                   of.products(),
                                   of.products().rows() / std::max<Index>(of.first.rows(), 1));
                             })
      .def(
          "states",
          [](const SpanRelation& of, const Matrix& ends, const Matrix& loads) {
            require_ends(ends, loads, of.first.rows(), of.known.cols());
            return of.states(ends, loads);
          },
          "ends"_a, "loads"_a);
  py::class_<LinearisedOrbit>(m, "LinearisedOrbit")
      .def(py::init(&linearised_orbit), "model"_a, "durations"_a, "starts"_a, "rates"_a, "method"_a,
           "frequency"_a, "mirror_sign"_a, "speeds"_a, "drive"_a, "by_frequency"_a,
           "speed_varies"_a, "of_states"_a, "forced"_a, "most"_a)
      .def_readonly("unit", &LinearisedOrbit::unit)
      .def_readonly("span", &LinearisedOrbit::span)
      .def_readonly("by_rates", &LinearisedOrbit::by_rates)
      .def_property_readonly("maps",
                             [](const LinearisedOrbit& of) { return stacked(of.maps, of.count()); })
      .def(
          "restored",
          [](const LinearisedOrbit& of, const Matrix& ends, const Matrix& loads) {
            require_ends(ends, loads, of.span.first.rows(), of.span.known.cols());
            return of.restored(ends, loads);
          },
          "ends"_a, "loads"_a)
      .def(
          "change",
          [](const LinearisedOrbit& of, const Vector& phase, double shift, const Vector& row,
             double gap, double share, const Vector& turn) {
            const Index size = of.unknowns();
            if (phase.size() != size || row.size() != size || of.span.known.cols() == 0) {
              throw py::value_error("phase and row must hold " + std::to_string(size) +
                                    " numbers, and equations must have loads");
            }
            if (turn.size() != 0 && turn.size() != of.span.first.rows()) {
              throw py::value_error("turn must be empty or hold a state's numbers");
            }
            std::optional<Vector> found = of.change(phase, shift, row, gap, share, turn);
            if (!found) refuse_singular();
            return *std::move(found);
          },
          "phase"_a, "shift"_a, "row"_a, "gap"_a, "share"_a, "turn"_a = Vector());
  py::class_<NearestPoint>(m, "NearestPoint")
      .def(py::init<Matrix, Matrix, Matrix>(), "points"_a, "once"_a = Matrix(),
           "twice"_a = Matrix())
      .def("__call__", &nearest_points, "states"_a, "most"_a);
  m.def("stage_states", &stage_states, "durations"_a, "starts"_a, "rates"_a, "method"_a);
  m.def("exponentials", &exponentials, "exponents"_a);
  m.def("interval_maps", &interval_maps, "rows"_a, "durations"_a, "parts"_a, "begins"_a, "unit"_a,
        "zeroth"_a, "first"_a);
  m.def("orbit_states", &states_of, "edges"_a, "starts"_a, "rates"_a, "frequency"_a,
        "mirror_sign"_a, "single"_a, "twofold"_a, "phases"_a);
}

}  // namespace pipedyn
