// SPDX-License-Identifier: MIT
// Spectra of linear models, and the searches over them.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/gil_safe_call_once.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <span>
#include <stdexcept>
#include <thread>

#include "arguments.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/galerkin/panel_pencil.hpp"
#include "pipedyn/linear/eigenproblem.hpp"
#include "pipedyn/linear/neighbours.hpp"
#include "pipedyn/linear/neutral.hpp"
#include "pipedyn/linear/structured.hpp"
#include "pipedyn/linear/tracking.hpp"
#include "pipedyn/linear/truncated.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// BLAS and LAPACK of SciPy, called at the addresses that SciPy publishes for Cython.
Lapack found_lapack() {
  Lapack lapack{};
  const auto set = [](const char* library, const char* name, auto& routine) {
    const py::object found = py::module_::import("pipedyn.util.lapack").attr("library")(library);
    const py::capsule address = found.attr("__pyx_capi__")[name];
    routine = reinterpret_cast<std::decay_t<decltype(routine)>>(address.get_pointer());
  };
  set("cython_blas", "dgemm", lapack.dgemm);
  set("cython_lapack", "dgetrf", lapack.dgetrf);
  set("cython_lapack", "dgetrs", lapack.dgetrs);
  set("cython_lapack", "zgetrf", lapack.zgetrf);
  set("cython_lapack", "zgetrs", lapack.zgetrs);
  set("cython_lapack", "dgeev", lapack.dgeev);
  set("cython_lapack", "dggev", lapack.dggev);
  set("cython_lapack", "zgeev", lapack.zgeev);
  set("cython_lapack", "dsygvd", lapack.dsygvd);
  return lapack;
}

/// Traits and ranges as Python gives them: thousands of objects of their own would take longer.
using TraitsRow = std::tuple<Index, double, double, bool, bool, bool, bool, double>;
using RangeRow = std::tuple<double, double, Index, Index, Index, Index, bool>;
template <class Made>
Made from_row(const auto& row) {
  return std::apply([](auto... numbers) { return Made{numbers...}; }, row);
}

/// Reports to Python at intervals how much work was done. Python counts it, and may stop the search
/// by a signal or by an exception of the function that counts.
class Report {
 public:
  Report(std::shared_ptr<Spectrum> spectrum, const py::object& count_work)
      : spectrum_(std::move(spectrum)), count_work_(count_work) {}

  /// Reports the work of one search of many, and begins the next.
  void next_search(std::shared_ptr<Spectrum> next) {
    done_ += spectrum_->factorisations();
    spectrum_ = std::move(next);
  }

  void operator()() {
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < std::chrono::milliseconds(20)) return;
    last_ = now;
    const py::gil_scoped_acquire locked;
    send();
  }

  void send() {
    count_work_(std::exchange(done_, 0) + spectrum_->factorisations());
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }

 private:
  std::shared_ptr<Spectrum> spectrum_;
  int done_ = 0;
  const py::object& count_work_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

// The addresses are looked up by the first dense problem, as loading SciPy's LAPACK takes a while.
const Lapack& scipy_lapack() {
  PYBIND11_CONSTINIT static py::gil_safe_call_once_and_store<Lapack> found;
  return found.call_once_and_store_result(found_lapack).get_stored();
}

void define_linear(py::module_& m) {
  m.def(
      "assignment",
      [](const Matrix& cost) {
        if (cost.rows() != cost.cols() || !cost.allFinite()) {
          throw py::value_error("cost must be a square matrix of finite numbers");
        }
        return assignment({cost.data(), cost.data() + cost.size()}, cost.rows());
      },
      "cost"_a);
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const NotConverged& error) {
      py::set_error(py::module_::import("pipedyn.util.errors").attr("NotConverged"), error.what());
    }
  });
  m.attr("dense_limit") = dense_limit;
  py::class_<Pairs>(m, "Pairs")
      .def(py::init<Values, ComplexTable, ComplexTable, Reals>(), "values"_a, "right"_a,
           "left"_a = ComplexTable(), "residuals"_a = Reals())
      .def_readonly("values", &Pairs::values)
      .def_readonly("right", &Pairs::right)
      .def_readonly("left", &Pairs::left)
      .def_readonly("residuals", &Pairs::residual)
      .def_readonly("uncertain", &Pairs::uncertain)
      .def_readonly("slopes", &Pairs::slopes)
      .def_property_readonly("converged", [](const Pairs& pairs) {
        return Eigen::Array<bool, Eigen::Dynamic, 1>(pairs.converged());
      });
  py::class_<Forms>(m, "Forms")
      .def(py::init<Complex, Complex, Complex, Complex, Complex, Complex, ComplexVector>(),
           "mass"_a, "velocity"_a, "damping"_a, "flux"_a, "gravity"_a, "by_damping"_a,
           "springs"_a = ComplexVector())
      .def_readonly("mass", &Forms::mass)
      .def_readonly("velocity", &Forms::velocity)
      .def_readonly("damping", &Forms::damping)
      .def_readonly("flux", &Forms::flux)
      .def_readonly("gravity", &Forms::gravity)
      .def_readonly("by_damping", &Forms::by_damping)
      .def_readonly("springs", &Forms::springs);
  py::class_<AxisCrossing>(m, "AxisCrossing")
      .def_readonly("speed", &AxisCrossing::speed)
      .def_readonly("value", &AxisCrossing::value)
      .def_property_readonly(
          "frequency", [](const AxisCrossing& crossing) { return std::abs(crossing.value.imag()); })
      .def_readonly("change", &AxisCrossing::change)
      .def_readonly("before", &AxisCrossing::before)
      .def_readonly("gyroscopic", &AxisCrossing::gyroscopic)
      .def_readonly("mode", &AxisCrossing::mode)
      .def_readonly("error", &AxisCrossing::error)
      .def_property_readonly("slope",
                             [](const AxisCrossing& crossing) { return crossing.pair.slope; })
      .def_property_readonly(
          "vectors",
          [](const AxisCrossing& one) -> std::optional<std::pair<ComplexTable, ComplexTable>> {
            if (one.pair.right.size() == 0) return {};
            return std::pair(one.pair.right, one.pair.left);
          });
  py::class_<Sweep>(m, "Sweep")
      .def_property_readonly("crossings", [](const Sweep& sweep) { return sweep.crossings; })
      .def_readonly("failure", &Sweep::failure)
      .def_readonly("untracked", &Sweep::untracked);

  py::class_<RootLoci>(m, "RootLoci")
      .def_readonly("values", &RootLoci::values)
      .def_readonly("partners", &RootLoci::partners)
      .def_readonly("converged", &RootLoci::converged)
      .def_readonly("errors", &RootLoci::errors);

  py::class_<Spectrum, std::shared_ptr<Spectrum>>(m, "Spectrum")
      .def(
          "root_loci",
          [](const std::shared_ptr<Spectrum>& spectrum, const std::vector<double>& speeds,
             Index count, Index roots, const py::object& count_work, const py::object& row_done) {
            Report report(spectrum, count_work);
            Index counted = 1;  // the first speed is where tracking starts
            const auto sampled = [&](Index rows) {
              report();
              if (row_done.is_none() || rows == counted) return;
              const py::gil_scoped_acquire locked;
              for (; counted < rows; ++counted) row_done();
            };
            std::optional<RootLoci> found;
            {
              const py::gil_scoped_release unlocked;
              found = root_loci(*spectrum, speeds, count, roots, sampled);
            }
            report.send();
            return found;
          },
          "speeds"_a, "count"_a, "roots"_a, "count_work"_a, "row_done"_a = py::none())
      .def(
          "forms",
          [](const Spectrum& spectrum, const AxisCrossing& of) { return spectrum.forms(of.pair); },
          "crossing"_a)
      .def("set_without_loss", &Spectrum::set_without_loss, "other"_a)
      .def("factorisations", &Spectrum::factorisations);

  m.attr("SHIFT") = shifts[0];
  m.def(
      "rounding",
      [](const Values& values) {
        Reals found;
        rounding_about(values, shifts[0], false, found);
        return found;
      },
      "values"_a);
  m.def(
      "crossings",
      [](const std::vector<std::shared_ptr<Spectrum>>& spectra, const std::vector<RangeRow>& rows,
         const py::object& count_work) {
        std::vector<Sweep> found(spectra.size());
        if (spectra.empty()) return found;
        if (rows.size() != spectra.size()) throw py::value_error("each spectrum needs a range");
        std::vector<Range> ranges;
        for (const RangeRow& row : rows) ranges.push_back(from_row<Range>(row));
        Report report(spectra[0], count_work);
        {
          const py::gil_scoped_release unlocked;
          const std::thread::id caller = std::this_thread::get_id();
          std::atomic<bool> stopped = false;
          // Some four searches are worth a thread. Only the caller's thread may ask Python whether
          // to stop.
          in_parts(static_cast<Index>(spectra.size()), worth_a_thread / 2, [&](Index i, Index end) {
            const bool own = std::this_thread::get_id() == caller;
            const auto stop_too = [&] {
              if (stopped) throw std::runtime_error("another thread's search was stopped");
            };
            try {
              const std::function<void()> asked = own ? std::ref(report) : std::function(stop_too);
              const auto begins = [&](Index k) {
                if (own) report.next_search(spectra[i + k]);
              };
              const auto part = [&](auto& of) { return std::span(of).subspan(i, end - i); };
              search_together(part(spectra), part(ranges), begins, asked, part(found));
            } catch (...) {
              if (own) stopped = true;
              throw;
            }
          });
        }
        for (const std::shared_ptr<Spectrum>& one : spectra) report.next_search(one);
        report.send();
        return found;
      },
      "spectra"_a, "ranges"_a, "count_work"_a);

  m.def(
      "general_values",
      [](const Matrix& a, const Matrix& b) {
        const bool alike = a.rows() == a.cols() && b.rows() == a.rows() && b.cols() == a.cols();
        if (!alike || !a.allFinite() || !b.allFinite()) {
          throw py::value_error("a and b must be finite, square and of the same size");
        }
        return general_values(scipy_lapack(), a, b);
      },
      "a"_a, "b"_a);
  py::class_<PanelPencil, std::shared_ptr<PanelPencil>>(m, "PanelPencil")
      .def(py::init([](const Galerkin& model) {
             return std::make_unique<PanelPencil>(model.pipe(), model.basis());
           }),
           "model"_a)
      .def_static(
          "fits",
          [](const Galerkin& model) { return PanelPencil::fits(model.pipe(), model.basis()); },
          "model"_a)
      .def(
          "times",
          [](const PanelPencil& pencil, const Matrix& x, double stiffness, double damping,
             double mass, double velocity, double flux, double gravity, double by_damping) {
            return pencil.times(x, {stiffness, damping, mass, velocity, flux, gravity, by_damping});
          },
          "x"_a, "stiffness"_a = 0.0, "damping"_a = 0.0, "mass"_a = 0.0, "velocity"_a = 0.0,
          "flux"_a = 0.0, "gravity"_a = 0.0, "by_damping"_a = 0.0, Unlocked())
      .def(
          "on_panels",
          [](const PanelPencil& pencil, const Matrix& q) { return pencil.basis().on_panels(q); },
          "q"_a);

  py::class_<Eigenproblem, Spectrum, std::shared_ptr<Eigenproblem>>(m, "Eigenproblem")
      .def(py::init([](const TraitsRow& row, DenseOperator::Matrices matrices,
                       double end_coefficient, double size, double rounding) {
             const auto traits = from_row<Traits>(row);
             std::array<double, 6> lost{};
             for (std::size_t k = 0; k < lost.size(); ++k) lost[k] = rounding * matrices[k].norm();
             return std::make_shared<Eigenproblem>(
                 traits, Pencil{scipy_lapack(), std::move(matrices), end_coefficient, size, lost,
                                static_cast<double>(traits.dof + 2) * eps});
           }),
           "traits"_a, "matrices"_a, "end_coefficient"_a, "size"_a, "rounding"_a = 0.0)
      .def(
          "lowest",
          [](Eigenproblem& of, double u, Index count, bool left, bool high) {
            Pairs found;
            of.lowest(u, count, left, high, found);
            return found;
          },
          "u"_a, "count"_a, "left"_a, "high"_a, Unlocked())
      .def(
          "by_recursion",
          [](Eigenproblem& of, double u, Index count, bool vectors) -> std::optional<Pairs> {
            if (Pairs found; of.by_recursion(u, count, vectors, found)) return found;
            return {};
          },
          "u"_a, "count"_a, "vectors"_a, Unlocked())
      .def(
          "modes_at_rest",
          [](Eigenproblem& of) -> std::optional<Matrix> {
            const std::optional<Modes>& modes = of.modes_at_rest();
            return modes ? std::optional<Matrix>(modes->vectors) : std::nullopt;
          },
          Unlocked())
      .def("assess", &Eigenproblem::assess, "u"_a, "pairs"_a, Unlocked());
  py::class_<Complement>(m, "Complement")
      .def_property_readonly("dof", &Complement::dof)
      .def(py::init<Matrix>(), "columns"_a)
      .def("lifted", &Complement::lifted, "z"_a)
      .def("projected", &Complement::projected, "x"_a);
  py::class_<Structured, Eigenproblem, std::shared_ptr<Structured>>(m, "Structured")
      .def(py::init([](const TraitsRow& traits, const std::shared_ptr<Chain>& chain,
                       const std::optional<Complement>& complement, double size) {
             const auto of = std::make_shared<const ChainDeterminant>(
                 chain, complement.value_or(Complement(Matrix(chain->dof(), 0))), scipy_lapack());
             return std::make_shared<Structured>(from_row<Traits>(traits), of, size);
           }),
           "traits"_a, "chain"_a, "complement"_a, "size"_a)
      .def(py::init([](const TraitsRow& traits, std::shared_ptr<PanelPencil> pencil,
                       const Matrix& lift, const Matrix& projection, double size) {
             const auto of = std::make_shared<const PanelDeterminant>(
                 std::move(pencil), scipy_lapack(), lift, projection);
             return std::make_shared<Structured>(from_row<Traits>(traits), of, size);
           }),
           "traits"_a, "pencil"_a, "lift"_a, "projection"_a, "size"_a)
      .def(
          "log_derivatives",
          [](const Structured& of, double u, const Values& at) {
            Values found(at.size());
            of.log_derivatives(u, at, Values(), found);
            return found;
          },
          "u"_a, "values"_a);
  py::class_<Truncated, Spectrum, std::shared_ptr<Truncated>>(m, "Truncated")
      .def(py::init<std::shared_ptr<Structured>, std::shared_ptr<Structured>, Index>(), "fewer"_a,
           "more"_a, "resolved"_a)
      .def("of_larger", py::overload_cast<Sweep, double, Index>(&Truncated::of_larger), "sweep"_a,
           "end"_a, "resolved"_a, Unlocked());
}

}  // namespace pipedyn
