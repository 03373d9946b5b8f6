// SPDX-License-Identifier: MIT
// Spectra of linear models, and the searches over them.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include <chrono>

#include "arguments.hpp"
#include "pipedyn/linear/crossings.hpp"
#include "pipedyn/linear/eigenproblem.hpp"
#include "pipedyn/linear/loci.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

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

/// Of a long model, by functions in Python (see `pipedyn.linear.arnoldi`).
class LongOperator : public Operator {
 public:
  LongOperator(py::object functions, Index rows, double stiffness_size)
      : Operator(rows, stiffness_size), functions_(std::move(functions)) {}
  ~LongOperator() override {
    const py::gil_scoped_acquire locked;
    functions_ = py::object();
  }

  Products multiply(const ComplexTable& x) const override {
    const py::gil_scoped_acquire locked;
    const auto made = functions_.attr("multiply")(x).cast<std::array<ComplexTable, 3>>();
    return {made[0], made[1], made[2]};
  }

  ComplexTable by_speed(const Values& values, const ComplexTable& x) const override {
    const py::gil_scoped_acquire locked;
    return functions_.attr("by_speed")(values, x).cast<ComplexTable>();
  }

  Solver factor(Complex value) const override {
    const py::gil_scoped_acquire locked;
    const auto solve = std::make_shared<Unlocked>(functions_.attr("factor")(value));
    return [solve](ComplexVector& x, bool adjoint) {
      const py::gil_scoped_acquire again;
      x = solve->function(ComplexTable(x), adjoint).cast<ComplexTable>();
    };
  }

  Inverse inverse(double shift, bool velocity_free, bool left, Index count) const override {
    const py::gil_scoped_acquire locked;
    auto [mu, right, lefts] = functions_.attr("inverse")(shift, velocity_free, left, count)
                                  .cast<std::tuple<Values, ComplexTable, ComplexTable>>();
    return {std::move(mu), std::move(right), std::move(lefts)};
  }

 private:
  /// Given up with the lock, wherever that is.
  struct Unlocked {
    explicit Unlocked(py::object solve) : function(std::move(solve)) {}
    ~Unlocked() {
      const py::gil_scoped_acquire locked;
      function = py::object();
    }
    py::object function;
  };

  py::object functions_;
};

/// Corrections by functions in Python (see `pipedyn.linear.special.stiff_roots`), any of them None.
Corrections corrections_of(const py::object& amend, const py::object& known,
                           const py::object& refined) {
  Corrections corrections;
  if (!amend.is_none()) {
    corrections.amend = [amend](double u, bool velocity_free, Pairs& pairs) {
      const py::gil_scoped_acquire locked;
      std::tie(pairs.values, pairs.right, pairs.left) =
          amend(u, pairs.values, pairs.right, pairs.left, velocity_free)
              .cast<std::tuple<Values, ComplexTable, ComplexTable>>();
    };
  }
  if (!known.is_none()) {
    corrections.known = [known](double u, Pair& pair) {
      const py::gil_scoped_acquire locked;
      const py::object found = known(u, pair.value);
      if (found.is_none()) return false;
      std::tie(pair.residual, pair.uncertain, pair.slope) =
          found.cast<std::tuple<double, double, Complex>>();
      return true;
    };
  }
  if (!refined.is_none()) {
    corrections.refined = [refined](double u, Pair& guess) {
      const py::gil_scoped_acquire locked;
      const py::object found = refined(u, guess.value);
      if (found.is_none()) return false;
      std::tie(guess.value, guess.right, guess.left, guess.residual) =
          found.cast<std::tuple<Complex, ComplexVector, ComplexVector, double>>();
      return true;
    };
  }
  return corrections;
}

/// The operators of a model in matrices, made without Python.
struct DenseOperators {
  Eigenproblem::At at;
};

Eigenproblem::At operators_of(const py::object& at) {
  if (py::isinstance<DenseOperators>(at)) return at.cast<DenseOperators>().at;
  return [at](double u) -> std::shared_ptr<const Operator> {
    const py::gil_scoped_acquire locked;
    return at(u).cast<std::shared_ptr<Operator>>();
  };
}

/// Tells Python every so often what was done, so that it counts and can stop it: by a signal, or by
/// an exception of what is told.
class Report {
 public:
  Report(Spectrum& spectrum, const py::object& factorised)
      : spectrum_(spectrum), factorised_(factorised) {}

  void operator()() {
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < std::chrono::milliseconds(20)) return;
    last_ = now;
    const py::gil_scoped_acquire locked;
    tell();
  }

  void tell() {
    factorised_(spectrum_.factorisations());
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }

 private:
  Spectrum& spectrum_;
  const py::object& factorised_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

template <class Part>
auto vectors_of(ComplexVector Part::* vectors) {
  return [vectors](const Part& pair) { return ComplexTable(pair.*vectors); };
}

}  // namespace

void define_linear(py::module_& m) {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const NotConverged& error) {
      py::set_error(py::module_::import("pipedyn.models.base").attr("NotConverged"), error.what());
    }
  });
  py::class_<Pair>(m, "Pair")
      .def_readonly("value", &Pair::value)
      .def_readonly("slope", &Pair::slope)
      .def_readonly("uncertain", &Pair::uncertain)
      .def_property_readonly("converged", &Pair::converged)
      .def_property_readonly("right", vectors_of(&Pair::right))
      .def_property_readonly("left", vectors_of(&Pair::left));
  py::class_<Pairs>(m, "Pairs")
      .def_readonly("values", &Pairs::values)
      .def_readonly("right", &Pairs::right)
      .def_readonly("left", &Pairs::left)
      .def_readonly("residuals", &Pairs::residual)
      .def_property_readonly("converged", [](const Pairs& pairs) {
        Eigen::Array<bool, Eigen::Dynamic, 1> good(pairs.values.size());
        for (Index i = 0; i < good.size(); ++i) {
          good[i] = has_converged(pairs.values[i], pairs.residual[i]);
        }
        return good;
      });
  py::class_<AxisCrossing>(m, "AxisCrossing")
      .def_readonly("speed", &AxisCrossing::speed)
      .def_readonly("value", &AxisCrossing::value)
      .def_readonly("change", &AxisCrossing::change)
      .def_readonly("mode", &AxisCrossing::mode)
      .def_readonly("error", &AxisCrossing::error)
      .def_property_readonly("pair", [](const AxisCrossing& crossing) -> std::optional<Pair> {
        if (crossing.pair.right.size() == 0) return {};
        return crossing.pair;
      });
  py::class_<Sweep>(m, "Sweep")
      .def_readonly("unstable_at_rest", &Sweep::unstable_at_rest)
      .def_readonly("crossings", &Sweep::crossings)
      .def_readonly("failure", &Sweep::failure)
      .def_readonly("untracked", &Sweep::untracked);

  py::class_<Spectrum, std::shared_ptr<Spectrum>>(m, "Spectrum")
      .def(
          "crossings",
          [](Spectrum& spectrum, double max_speed, double scale, Index count, Index tracked,
             Index resolved, Index certain, bool until_unstable, const py::object& factorised) {
            Report report(spectrum, factorised);
            Sweep found;
            {
              const py::gil_scoped_release unlocked;
              found = crossings(
                  spectrum, {max_speed, scale, count, tracked, resolved, certain, until_unstable},
                  std::ref(report));
            }
            report.tell();
            return found;
          },
          "max_speed"_a, "scale"_a, "count"_a, "tracked"_a, "resolved"_a, "certain"_a,
          "until_unstable"_a, "factorised"_a)
      .def(
          "root_loci",
          [](Spectrum& spectrum, const std::vector<double>& speeds, Index count, Index taken,
             const py::object& factorised, const py::object& row_done) -> py::object {
            Report report(spectrum, factorised);
            Index told = 0;
            const auto sampled = [&](Index rows) {
              report();
              if (row_done.is_none() || rows == told) return;
              const py::gil_scoped_acquire locked;
              for (; told < rows; ++told) row_done();
            };
            std::optional<std::vector<LociRow>> found;
            {
              const py::gil_scoped_release unlocked;
              found = root_loci(spectrum, speeds, count, taken, sampled);
            }
            report.tell();
            if (!found) return py::none();
            const Index size = static_cast<Index>(found->size());
            Eigen::ArrayXXcd values(size, count), partners(size, count);
            Eigen::ArrayXXd errors(size, count);
            Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> converged(size, count);
            for (Index i = 0; i < size; ++i) {
              const LociRow& row = (*found)[i];
              values.row(i) = row.values;
              partners.row(i) = row.partners;
              errors.row(i) = row.errors;
              for (Index k = 0; k < count; ++k) converged(i, k) = row.converged[k] != 0;
            }
            return py::make_tuple(values, partners, converged, errors);
          },
          "speeds"_a, "count"_a, "taken"_a, "factorised"_a, "row_done"_a = py::none())
      .def(
          "refined",
          [](Spectrum& spectrum, double u, Complex value, const std::optional<Pair>& near) {
            Pair guess = near.value_or(Pair{});
            guess.value = value;
            const py::gil_scoped_release unlocked;
            return spectrum.refined(u, guess);
          },
          "u"_a, "value"_a, "near"_a = py::none())
      .def("factorisations", &Spectrum::factorisations);

  py::class_<Operator, std::shared_ptr<Operator>>(m, "Operator");
  py::class_<LongOperator, Operator, std::shared_ptr<LongOperator>>(m, "LongOperator")
      .def(py::init<py::object, Index, double>(), "functions"_a, "dof"_a, "size"_a);
  const Lapack lapack = scipy_lapack();
  py::class_<DenseOperator, Operator, std::shared_ptr<DenseOperator>>(m, "DenseOperator")
      .def(py::init([lapack](const std::array<Matrix, 5>& of, double size) {
             return DenseOperator(lapack, of[0], of[1], of[2], of[3], of[4], size);
           }),
           "matrices"_a, "size"_a)
      .def(
          "inverse",
          [](const DenseOperator& p, double shift, bool velocity_free, bool left) {
            Inverse found;
            {
              const py::gil_scoped_release unlocked;
              found = p.inverse(shift, velocity_free, left, 0);
            }
            return py::make_tuple(found.mu, found.right, found.left);
          },
          "shift"_a, "velocity_free"_a, "left"_a);
  py::class_<DenseOperators>(m, "DenseOperators")
      .def(py::init([lapack](const std::array<Matrix, 5>& of, double centrifugal, double size) {
             return DenseOperators{
                 dense_operators(lapack, {of[0], of[1], of[2], of[3], of[4]}, centrifugal, size)};
           }),
           "matrices"_a, "centrifugal"_a, "size"_a)
      .def(
          "__call__",
          [](const DenseOperators& operators, double u) {
            return std::const_pointer_cast<Operator>(operators.at(u));
          },
          "u"_a);
  py::class_<Eigenproblem, Spectrum, std::shared_ptr<Eigenproblem>>(m, "Eigenproblem")
      .def(py::init([](Index dof, double delta, double zero, bool damped, bool conservative,
                       bool squared, const py::object& at, bool complete, bool free_at_rest,
                       const py::object& amend, const py::object& known, const py::object& refined,
                       std::shared_ptr<Eigenproblem> statics) {
             return std::make_shared<Eigenproblem>(
                 Traits{dof, delta, zero, damped, conservative, squared}, operators_of(at),
                 complete, free_at_rest, corrections_of(amend, known, refined), std::move(statics));
           }),
           "dof"_a, "delta"_a, "zero"_a, "damped"_a, "conservative"_a, "squared"_a, "operators"_a,
           "complete"_a, "free_at_rest"_a, "amend"_a = py::none(), "known"_a = py::none(),
           "refined"_a = py::none(), "statics"_a = nullptr)
      .def("lowest", &Eigenproblem::lowest, "u"_a, "count"_a, "left"_a, "high"_a,
           py::call_guard<py::gil_scoped_release>())
      .def(
          "assessed",
          [](Eigenproblem& problem, double u, Values values, ComplexTable right,
             const std::optional<ComplexTable>& left, const std::optional<Reals>& residual) {
            const Pairs pairs{std::move(values), std::move(right),
                              left.value_or(ComplexTable(problem.traits.dof, 0)),
                              residual.value_or(Reals())};
            Assessment found;
            {
              const py::gil_scoped_release unlocked;
              found = problem.assessed(u, pairs, left.has_value());
            }
            return py::make_tuple(found.residual, found.uncertain, found.slope, found.by_left);
          },
          "u"_a, "values"_a, "right"_a, "left"_a = py::none(), "residual"_a = py::none());
}

}  // namespace pipedyn
