// SPDX-License-Identifier: MIT
// Eigenpairs and their tracking along the flow speed.
#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/linear/eigenpairs.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

using ComplexNumbers = py::array_t<Complex, py::array::c_style | py::array::forcecast>;

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

/// M, C and K.
using Matrices = std::array<Numbers, 3>;

Quadratic quadratic(const Matrices& p) {
  const auto map = [](const Numbers& a) {
    return Eigen::Map<const Matrix>(a.data(), a.shape(0), a.shape(0));
  };
  return {map(p[0]), map(p[1]), map(p[2])};
}

}  // namespace

void define_linear(py::module_& m) {
  m.def(
      "inverse",
      [lapack = scipy_lapack()](const Matrices& matrices, double shift, bool velocity_free,
                                bool left) {
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
      [](const ComplexNumbers& values, const ComplexNumbers& right,
         const std::optional<ComplexNumbers>& left, const std::optional<Numbers>& residual,
         const std::optional<ComplexNumbers>& by_speed,
         const std::variant<Matrices, std::array<ComplexNumbers, 3>>& operators, double size) {
        const auto data = [](const auto& array) { return array ? array->data() : nullptr; };
        const Pairs pairs{right.shape(0), right.shape(1), values.data(),  right.data(),
                          data(left),     data(by_speed), data(residual), size};
        Assessment found;
        if (const auto* const matrices = std::get_if<Matrices>(&operators)) {
          const Quadratic p = quadratic(*matrices);
          run(pairs.dof * pairs.count, [&] { found = assess(pairs, p); });
        } else {
          const auto& [mass, velocity, stiffness] = std::get<1>(operators);
          const Products products{mass.data(), velocity.data(), stiffness.data(), nullptr};
          run(pairs.dof, [&] { found = assess(pairs, products); });
        }
        return py::make_tuple(numbers_of(found.residual), numbers_of(found.uncertain),
                              numbers_of(found.slope), numbers_of(found.correction),
                              numbers_of(found.by_left), numbers_of(found.by_right));
      },
      "values"_a, "right"_a, "left"_a, "residual"_a, "by_speed"_a, "operators"_a, "size"_a);
}

}  // namespace pipedyn
