// SPDX-License-Identifier: MIT
// Eigenpairs and their tracking along the flow speed.
#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/linear/chain_spectrum.hpp"
#include "pipedyn/linear/eigenpairs.hpp"
#include "pipedyn/linear/tracking.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

template <class T>
using Column = py::array_t<T, py::array::c_style | py::array::forcecast>;

/// SciPy's BLAS and LAPACK, by the addresses that it publishes for Cython.
Lapack scipy_lapack() {
  Lapack lapack{};
  const auto set = [](const char* library, const char* name, auto& routine) {
    const py::dict all = py::module_::import(library).attr("__pyx_capi__");
    const py::capsule address = all[name];
    routine = reinterpret_cast<std::decay_t<decltype(routine)>>(address.get_pointer());
  };
  set("scipy.linalg.cython_blas", "dgemm", lapack.dgemm);
  set("scipy.linalg.cython_lapack", "dgetrf", lapack.dgetrf);
  set("scipy.linalg.cython_lapack", "dgetrs", lapack.dgetrs);
  set("scipy.linalg.cython_lapack", "zgetrf", lapack.zgetrf);
  set("scipy.linalg.cython_lapack", "zgetrs", lapack.zgetrs);
  set("scipy.linalg.cython_lapack", "dgeev", lapack.dgeev);
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

Matrix matrix_of(const Numbers& values) {
  return Eigen::Map<const Matrix>(values.data(), values.shape(0), values.shape(1));
}

/// Of a long chain, by functions: x, (dof, count), to M x, C x and K x; value, x and y to P^-1 x
/// and P^-H y.
class LongOperator : public Operator {
 public:
  LongOperator(py::object multiply, py::object solve, Index dof, double size)
      : Operator(dof, size), multiply_(std::move(multiply)), solve_(std::move(solve)) {}

  ComplexTable multiply(const Complex* x, Index count) const override {
    const py::gil_scoped_acquire locked;
    ComplexTable result;
    for (const auto& part : multiply_(table(x, count)).cast<std::array<Column<Complex>, 3>>()) {
      result.insert(result.end(), part.data(), part.data() + part.size());
    }
    return result;
  }

  void solve(Complex value, ComplexTable& x, ComplexTable& y) const override {
    const py::gil_scoped_acquire locked;
    const auto solved = solve_(value, table(x.data(), 1), table(y.data(), 1))
                            .cast<std::array<Column<Complex>, 2>>();
    x = vector_of(solved[0]);
    y = vector_of(solved[1]);
  }

 private:
  Column<Complex> table(const Complex* x, Index count) const {
    return Column<Complex>({dof, count}, x);
  }

  const py::object multiply_, solve_;
};

py::tuple roots_of(const ChainRoots& found) {
  const py::ssize_t count = found.values.size();
  const auto table = [&](const ComplexTable& x) {
    return py::array_t<Complex>({static_cast<py::ssize_t>(x.size()) / count, count}, x.data());
  };
  return py::make_tuple(numbers_of(found.values), table(found.right), table(found.left),
                        numbers_of(found.residual), numbers_of(found.uncertain),
                        numbers_of(found.slope), numbers_of(found.by_left),
                        numbers_of(found.by_right));
}

}  // namespace

void define_linear(py::module_& m) {
  py::class_<Operator>(m, "Operator")
      .def(
          "assess",
          [](const Operator& p, const Column<Complex>& values, const Column<Complex>& right,
             const std::optional<Column<Complex>>& left,
             const std::optional<Column<double>>& residual,
             const std::optional<Column<Complex>>& by_speed) {
            const auto data = [](const auto& array) { return array ? array->data() : nullptr; };
            const Pairs pairs{values.size(), values.data(),  right.data(),
                              data(left),    data(residual), data(by_speed)};
            Assessment found;
            run(right.size() / 8, [&] { found = assess(p, pairs); });
            return py::make_tuple(numbers_of(found.residual), numbers_of(found.uncertain),
                                  numbers_of(found.slope), numbers_of(found.by_left),
                                  numbers_of(found.by_right));
          },
          "values"_a, "right"_a, "left"_a = py::none(), "residual"_a = py::none(),
          "by_speed"_a = py::none())
      .def(
          "growth",
          [](const Operator& p, const Column<Complex>& values, const Column<Complex>& right,
             const Column<Complex>& left) {
            const Pairs pairs{values.size(), values.data(), right.data(), left.data()};
            Growth found;
            run(right.size() / 8, [&] { found = growth(p, pairs); });
            return py::make_tuple(numbers_of(found.rate), numbers_of(found.error));
          },
          "values"_a, "right"_a, "left"_a)
      .def(
          "refine",
          [](const Operator& p, Complex value, const Column<Complex>& right,
             const Column<Complex>& left, int steps) {
            Refined found{value, vector_of(right), vector_of(left), 0.0, 0};
            run(p.dof * p.dof, [&] { found = refine(p, std::move(found), steps); });
            return py::make_tuple(found.value, table_of(found.right, p.dof),
                                  table_of(found.left, p.dof), found.residual, found.steps);
          },
          "value"_a, "right"_a, "left"_a, "steps"_a);
  py::class_<DenseOperator, Operator>(m, "DenseOperator")
      .def(py::init([lapack = scipy_lapack()](const Numbers& mass, const Numbers& velocity,
                                              const Numbers& stiffness, double size) {
             return DenseOperator(lapack, matrix_of(mass), matrix_of(velocity),
                                  matrix_of(stiffness), size);
           }),
           "mass"_a, "velocity"_a, "stiffness"_a, "size"_a)
      .def(
          "inverse",
          [](const DenseOperator& p, double shift, bool velocity_free, bool left) {
            Inverse found;
            {
              const py::gil_scoped_release unlocked;
              found = p.inverse(shift, velocity_free, left);
            }
            return py::make_tuple(numbers_of(found.mu), table_of(found.right, p.dof),
                                  table_of(found.left, p.dof));
          },
          "shift"_a, "velocity_free"_a, "left"_a);
  py::class_<LongOperator, Operator>(m, "LongOperator")
      .def(py::init<py::object, py::object, Index, double>(), "multiply"_a, "solve"_a, "dof"_a,
           "size"_a);
  py::class_<ChainSpectrum>(m, "ChainSpectrum")
      .def(py::init([lapack = scipy_lapack()](const Chain& chain, Vector scale) {
             return ChainSpectrum(chain, lapack, std::move(scale));
           }),
           "chain"_a, "scale"_a, py::keep_alive<1, 2>())
      .def(
          "lowest",
          [](const ChainSpectrum& spectrum, double u, Index count, bool vectors) -> py::object {
            std::optional<ChainRoots> found;
            {
              const py::gil_scoped_release unlocked;
              found = spectrum.lowest(u, count, vectors);
            }
            return found ? py::object(roots_of(*found)) : py::none();
          },
          "u"_a, "count"_a, "vectors"_a)
      .def(
          "near",
          [](const ChainSpectrum& spectrum, double u, Complex guess, int steps) {
            return roots_of(spectrum.near(u, guess, steps));
          },
          "u"_a, "guess"_a, "steps"_a);
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
  py::class_<Scan>(m, "Scan")
      .def_property_readonly("roots", [](const Scan& found) { return numbers_of(found.roots); })
      .def_property_readonly("leaving", [](const Scan& found) { return flags_of(found.leaving); })
      .def_property_readonly("after", [](const Scan& found) { return flags_of(found.after); })
      .def_readonly("clear", &Scan::clear)
      .def_readonly("crossings", &Scan::crossings);
  m.def(
      "scan",
      [](const py::object& step, const Column<Root>& modes, const Column<bool>& before,
         Root resolved, Root certain, double zero, bool conservative) {
        const SampleArrays left(step.attr("left")), right(step.attr("right"));
        const Roots onto = vector_of(Column<Root>(step.attr("onto")));
        const Roots meets = vector_of(Column<Root>(step.attr("meets")));
        const Column<double> error(step.attr("error"));
        return scan({left.view(), right.view(), onto, meets, error.data(), vector_of(modes),
                     Flags(before.data(), before.data() + before.size())},
                    {resolved, certain, zero, conservative});
      },
      "step"_a, "modes"_a, "unstable"_a, "resolved"_a, "certain"_a, "zero"_a, "conservative"_a);
}

}  // namespace pipedyn
