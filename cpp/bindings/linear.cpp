// SPDX-License-Identifier: MIT
// Eigenpairs and their tracking along the flow speed.
#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/linear/eigenpairs.hpp"
#include "pipedyn/linear/tracking.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

template <class T>
using Column = py::array_t<T, py::array::c_style | py::array::forcecast>;

/// SciPy's LAPACK, by the addresses that it publishes for Cython.
Lapack scipy_lapack() {
  const py::dict all = py::module_::import("scipy.linalg.cython_lapack").attr("__pyx_capi__");
  Lapack lapack{};
  const auto set = [&all](const char* name, auto& routine) {
    const py::capsule address = all[name];
    routine = reinterpret_cast<std::decay_t<decltype(routine)>>(address.get_pointer());
  };
  set("dgetrf", lapack.dgetrf);
  set("dgetrs", lapack.dgetrs);
  set("zgetrf", lapack.zgetrf);
  set("zgetrs", lapack.zgetrs);
  set("dgeev", lapack.dgeev);
  return lapack;
}

template <class T>
py::array_t<T> table_of(const std::vector<T>& values, py::ssize_t rows) {
  const py::ssize_t size = static_cast<py::ssize_t>(values.size());
  return py::array_t<T>({rows, size / rows}, values.data());
}

template <class T>
py::array_t<T> numbers_of(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

template <class T>
std::vector<T> vector_of(const Column<T>& values) {
  return std::vector<T>(values.data(), values.data() + values.size());
}

Column<bool> flags_of(const Flags& flags) {
  Column<bool> result(static_cast<py::ssize_t>(flags.size()));
  std::copy(flags.begin(), flags.end(), result.mutable_data());
  return result;
}

/// The arrays of a `pipedyn.linear.tracking.Sample`.
struct SampleArrays {
  double u;
  Column<Complex> values, slopes;
  Column<double> noise, slope_noise;
  Column<std::int8_t> signatures;

  explicit SampleArrays(const py::object& at)
      : u(at.attr("u").cast<double>()),
        values(at.attr("values")),
        slopes(at.attr("slopes")),
        noise(at.attr("noise")),
        slope_noise(at.attr("slope_noise")),
        signatures(at.attr("signatures")) {}

  Sample view() const {
    return {u,
            values.size(),
            values.data(),
            slopes.data(),
            noise.data(),
            slope_noise.data(),
            signatures.data()};
  }
};

/// M, C and K.
using Matrices = std::array<Numbers, 3>;

Quadratic quadratic(const Matrices& p) {
  const auto map = [](const Numbers& a) {
    return Eigen::Map<const Matrix>(a.data(), a.shape(0), a.shape(0));
  };
  return {map(p[0]), map(p[1]), map(p[2])};
}

/// Of a long chain: x, (dof, count), to M x, C x and K x; value, x and y to P^-1 x and P^-H y.
using Functions = std::array<py::object, 2>;

Operator operator_of(const Functions& p, Index dof, double size) {
  const auto table = [dof](const Complex* x, Index count) {
    return Column<Complex>({dof, count}, x);
  };
  const auto multiply = [=](const Complex* x, Index count) {
    ComplexTable result;
    for (const auto& part : p[0](table(x, count)).cast<std::array<Column<Complex>, 3>>()) {
      result.insert(result.end(), part.data(), part.data() + part.size());
    }
    return result;
  };
  const auto solve = [=](Complex value, ComplexTable& x, ComplexTable& y) {
    const auto solved =
        p[1](value, table(x.data(), 1), table(y.data(), 1)).cast<std::array<Column<Complex>, 2>>();
    x = vector_of(solved[0]);
    y = vector_of(solved[1]);
  };
  return {dof, size, multiply, solve};
}

}  // namespace

void define_linear(py::module_& m) {
  const Lapack lapack = scipy_lapack();
  m.def(
      "inverse",
      [lapack](const Matrices& matrices, double shift, bool velocity_free, bool left) {
        Inverse found;
        {
          const py::gil_scoped_release unlocked;
          found = inverse(lapack, quadratic(matrices), shift, velocity_free, left);
        }
        const py::ssize_t rows = matrices[0].shape(0);
        return py::make_tuple(numbers_of(found.mu), table_of(found.right, rows),
                              table_of(found.left, rows));
      },
      "matrices"_a, "shift"_a, "velocity_free"_a, "left"_a);
  m.def(
      "assess",
      [lapack](const std::variant<Matrices, Functions>& p, double size,
               const Column<Complex>& values, const Column<Complex>& right,
               const std::optional<Column<Complex>>& left,
               const std::optional<Column<double>>& residual,
               const std::optional<Column<Complex>>& by_speed) {
        const auto data = [](const auto& array) { return array ? array->data() : nullptr; };
        const Index dof = right.shape(0), count = right.shape(1);
        Pairs pairs{count,          values.data(),  right.data(), data(left),
                    data(by_speed), data(residual), nullptr};
        Assessment found;
        if (const auto* const matrices = std::get_if<Matrices>(&p)) {
          const Quadratic q = quadratic(*matrices);
          run(dof * count, [&] {
            const std::vector<double> lost = left ? formed(q, pairs) : std::vector<double>();
            if (left) pairs.formed = lost.data();
            found = assess(operator_of(lapack, q, size), pairs);
          });
        } else {
          found = assess(operator_of(std::get<Functions>(p), dof, size), pairs);
        }
        return py::make_tuple(numbers_of(found.residual), numbers_of(found.uncertain),
                              numbers_of(found.slope), numbers_of(found.by_left),
                              numbers_of(found.by_right));
      },
      "p"_a, "size"_a, "values"_a, "right"_a, "left"_a, "residual"_a, "by_speed"_a);
  m.def(
      "refine",
      [lapack](const std::variant<Matrices, Functions>& p, double size, Complex value,
               const Column<Complex>& right, const Column<Complex>& left, int steps) {
        Refined found{value, vector_of(right), vector_of(left), 0.0, 0};
        if (const auto* const matrices = std::get_if<Matrices>(&p)) {
          const py::gil_scoped_release unlocked;
          const Quadratic q = quadratic(*matrices);
          found = refine(operator_of(lapack, q, size), std::move(found), steps);
        } else {
          const Index dof = right.size();
          found = refine(operator_of(std::get<Functions>(p), dof, size), std::move(found), steps);
        }
        return py::make_tuple(found.value, table_of(found.right, right.size()),
                              table_of(found.left, right.size()), found.residual, found.steps);
      },
      "p"_a, "size"_a, "value"_a, "right"_a, "left"_a, "steps"_a);
  m.def(
      "growth",
      [lapack](const std::variant<Matrices, Functions>& p, const Column<Complex>& values,
               const Column<Complex>& right, const Column<Complex>& left) {
        const Index dof = right.shape(0), count = right.shape(1);
        const Pairs pairs{count,   values.data(), right.data(), left.data(),
                          nullptr, nullptr,       nullptr};
        Growth found;
        if (const auto* const matrices = std::get_if<Matrices>(&p)) {
          const Quadratic q = quadratic(*matrices);
          run(dof * count, [&] { found = growth(operator_of(lapack, q, 0.0), pairs); });
        } else {
          found = growth(operator_of(std::get<Functions>(p), dof, 0.0), pairs);
        }
        return py::make_tuple(numbers_of(found.rate), numbers_of(found.error));
      },
      "p"_a, "values"_a, "right"_a, "left"_a);
  m.def(
      "match",
      [](const py::object& left, const py::object& right, const Column<Root>& tracked,
         double damping, double radius, double zero) {
        const SampleArrays from(left), to(right);
        Match found;
        run(from.values.size() * to.values.size() / 16, [&] {
          found = match(from.view(), to.view(), vector_of(tracked), {damping, radius, zero});
        });
        return py::make_tuple(numbers_of(found.onto), numbers_of(found.error),
                              numbers_of(found.meets), numbers_of(found.slopes), found.unambiguous);
      },
      "left"_a, "right"_a, "tracked"_a, "damping"_a, "radius"_a, "zero"_a);
  m.def(
      "unstable",
      [](const py::object& at, const Column<Root>& onto, const Column<bool>& before, double zero) {
        const Flags flags(before.data(), before.data() + before.size());
        return flags_of(unstable(SampleArrays(at).view(), vector_of(onto), flags, zero));
      },
      "at"_a, "onto"_a, "before"_a, "zero"_a);
  m.def(
      "scan",
      [](const py::object& step, const Column<Root>& modes, const Column<bool>& before,
         Root resolved, Root certain, double zero, bool conservative) {
        const SampleArrays left(step.attr("left")), right(step.attr("right"));
        const Roots onto = vector_of(Column<Root>(step.attr("onto")));
        const Roots meets = vector_of(Column<Root>(step.attr("meets")));
        const Column<double> error(step.attr("error"));
        const Scan found =
            scan({left.view(), right.view(), onto, meets, error.data(), vector_of(modes),
                  Flags(before.data(), before.data() + before.size())},
                 {resolved, certain, zero, conservative});
        std::vector<std::tuple<Root, double, bool>> crossings;
        for (const Scan::Crossing& one : found.crossings) {
          crossings.emplace_back(one.root, one.at, one.rising);
        }
        return py::make_tuple(numbers_of(found.roots), flags_of(found.leaving),
                              flags_of(found.after), found.clear, crossings);
      },
      "step"_a, "modes"_a, "unstable"_a, "resolved"_a, "certain"_a, "zero"_a, "conservative"_a);
}

}  // namespace pipedyn
