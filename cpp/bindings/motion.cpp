// SPDX-License-Identifier: MIT
// Integration in time.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <string>

#include "arguments.hpp"
#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/modular/systems.hpp"
#include "pipedyn/motion/dop853.hpp"
#include "pipedyn/motion/radau.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// Flow speeds at times, of which members.
using SpeedsAt =
    std::function<void(const Vector& t, const std::vector<Index>& which, Reals& speeds)>;

/// The value of a function u(t), which was tried at some times alone.
double checked_speed(const py::object& u, double t) {
  const auto name = [t] { return "u(" + std::to_string(t) + ")"; };
  double value = 0.0;
  try {
    value = u(t).cast<double>();
  } catch (const py::cast_error&) {
    throw py::type_error(name() + " must be a real number");
  }
  if (value >= 0.0 && std::isfinite(value)) return value;
  throw py::value_error(name() + " must be >= 0 and finite, got " + std::to_string(value));
}

/// u: one a member, or a function of time for all.
SpeedsAt speeds_at(const py::object& u) {
  if (!PyCallable_Check(u.ptr())) {
    return [all = u.cast<Reals>()](const Vector&, const std::vector<Index>& which, Reals& speeds) {
      speeds = all(which);
    };
  }
  return [u](const Vector& t, const std::vector<Index>&, Reals& speeds) {
    const py::gil_scoped_acquire locked;
    speeds.resize(t.size());
    for (Index j = 0; j < t.size(); ++j) speeds[j] = checked_speed(u, t[j]);
  };
}

/// A function of a compiled model's states at a speed each.
template <class Model, class Function>
Rates function_rates(const Model& model, const py::object& u, const Function& function) {
  return [&model, function, at = speeds_at(u), speeds = Reals()](const Vector& t, const double* y,
                                                                 const std::vector<Index>& which,
                                                                 double* rates) mutable {
    at(t, which, speeds);  // a force of their derivatives would enter beside them
    function(model, Batch{y, speeds.data(), speeds.size(), 1}, rates);
  };
}

/// Rates [q', q'', power] of a compiled model's states with the work done on them.
template <class Model>
Rates compiled_rates(const Model& model, const py::object& u) {
  return function_rates(model, u, std::mem_fn(&Model::rhs_and_power));
}

/// Those of a function of times, states (rows, members) and their speeds. A ValueError means that
/// there are none.
Rates called_rates(const py::function& function, Index rows, const py::object& u) {
  return [function, rows, at = speeds_at(u), speeds = Reals()](const Vector& t, const double* y,
                                                               const std::vector<Index>& which,
                                                               double* rates) mutable {
    at(t, which, speeds);
    const py::gil_scoped_acquire locked;
    const Index members = static_cast<Index>(which.size());
    Numbers states({rows, members});
    std::copy_n(y, rows * members, states.mutable_data());
    try {
      const Numbers found = function(t, states, speeds).cast<Numbers>();
      if (found.size() != rows * members)
        throw py::value_error("rates must have the states' shape");
      std::copy_n(found.data(), rows * members, rates);
    } catch (py::error_already_set& error) {
      if (!error.matches(PyExc_ValueError)) throw;
      std::fill_n(rates, rows * members, std::numeric_limits<double>::quiet_NaN());
    }
  };
}

Rates rates_of(const py::object& of, Index rows, const py::object& u) {
  if (py::isinstance<Chain>(of)) return compiled_rates(of.cast<const Chain&>(), u);
  if (py::isinstance<Galerkin>(of)) return compiled_rates(of.cast<const Galerkin&>(), u);
  if (py::isinstance<Scene>(of)) return compiled_rates(of.cast<const Scene&>(), u);
  return called_rates(of, rows, u);
}

/// Those of the same states without the work, by rhs, with their derivative, and the power apart.
template <class Model>
ImplicitRates implicit_rates(const Model& model, const py::object& u,
                             void (Model::*rhs)(const Batch&, double*) const,
                             std::unique_ptr<ShiftedSystems> systems) {
  return {function_rates(model, u, std::mem_fn(rhs)),
          function_rates(model, u,
                         [](const Model& of, const Batch& batch, double* out) {
                           Matrix parts(4, batch.members);
                           of.power(batch, parts.data());
                           Eigen::Map<Vector>(out, batch.members) = parts.colwise().sum();
                         }),
          2 * model.dof(), std::move(systems)};
}

/// Of a function of a time, a state (rows,) and its speed.
DenseSystems::Jacobian called_jacobian(const py::function& function, Index rows,
                                       const SpeedAt& speed) {
  return [function, rows, speed](double t, const double* y, Index member, double* out) {
    const double u = speed(t, member);
    const py::gil_scoped_acquire locked;
    const Numbers found = function(t, Numbers(rows, y), u).cast<Numbers>();
    if (found.size() != rows * rows) throw py::value_error("a Jacobian must have a row a state");
    std::copy_n(found.data(), rows * rows, out);
  };
}

ImplicitRates implicit_rates_of(const py::object& of, const py::object& jacobian, Index rows,
                                const py::object& u) {
  const SpeedAt speed = [at = speeds_at(u)](double t, Index member) {
    Reals one;
    at(Vector::Constant(1, t), {member}, one);
    return one[0];
  };
  if (py::isinstance<Chain>(of)) {
    const Chain& chain = of.cast<const Chain&>();
    return implicit_rates(chain, u, &Chain::rhs, std::make_unique<ChainSystems>(chain, speed));
  }
  if (py::isinstance<Scene>(of)) {
    const Scene& scene = of.cast<const Scene&>();
    return implicit_rates(scene, u, &Scene::rhs, std::make_unique<SceneSystems>(scene, speed));
  }
  if (py::isinstance<Galerkin>(of)) {
    const Galerkin& model = of.cast<const Galerkin&>();
    const auto slopes = [&model, speed](double t, const double* y, Index member, double* out) {
      const double u = speed(t, member);
      model.jacobian({y, &u, 1, 0}, out);
    };
    return implicit_rates(model, u, &Galerkin::rhs,
                          std::make_unique<DenseSystems>(slopes, 2 * model.dof()));
  }
  return {rates_of(of, rows, u), nullptr, rows,
          std::make_unique<DenseSystems>(called_jacobian(jacobian, rows, speed), rows)};
}

/// Explicit without a Jacobian.
std::unique_ptr<Integrator> integrator(const py::object& of, const py::object& u,
                                       const Matrix& start, double t0, double rtol, double atol,
                                       double most, double max_step, const py::object& jacobian) {
  const Index rows = start.rows(), members = start.cols();
  const Limits limits{rtol, atol, most, max_step};
  if (jacobian.is_none()) {
    return std::make_unique<Dop853>(rates_of(of, rows, u), rows, members, start.data(), t0, limits);
  }
  return std::make_unique<Radau>(implicit_rates_of(of, jacobian, rows, u), rows, members,
                                 start.data(), t0, limits);
}

/// Goes on; whether all members have finished, and where asked for the ends of steps and their
/// polynomials' coefficients.
auto advance(Integrator& motion, const Vector& times, Numbers out, Index evaluations, bool follow) {
  double* const to = out.mutable_data();
  std::vector<Interpolant> steps;
  bool finished = false;
  {
    const py::gil_scoped_release unlocked;
    finished = motion.advance(times, to, evaluations, follow ? &steps : nullptr);
  }
  std::vector<double> ends;
  std::vector<Matrix> coefficients;
  for (Interpolant& step : steps) {
    if (ends.empty()) ends.push_back(step.from);
    ends.push_back(step.to);
    coefficients.push_back(std::move(step.coefficients));
  }
  return std::tuple(finished, std::move(ends), std::move(coefficients));
}

}  // namespace

void define_motion(py::module_& m) {
  py::class_<Member>(m, "Member")
      .def_readonly("time", &Member::time)
      .def_readonly("samples", &Member::samples)
      .def_readonly("evaluations", &Member::evaluations)
      .def_property_readonly("progress", [](const Member& member) {
        constexpr const char* names[] = {"going", "done", "not finite", "vanishing", "spent"};
        return names[static_cast<int>(member.progress)];
      });
  py::class_<Integrator>(m, "Integrator")
      .def(py::init(&integrator), "of"_a, "u"_a, "start"_a, "t0"_a, "rtol"_a, "atol"_a, "most"_a,
           "max_step"_a = std::numeric_limits<double>::infinity(), "jacobian"_a = py::none(),
           py::keep_alive<1, 2>())
      .def("advance", advance, "times"_a, "out"_a.noconvert(), "evaluations"_a, "follow"_a = false)
      .def("state", &Integrator::state, "member"_a)
      .def("stop", &Integrator::stop, "member"_a)
      .def_property_readonly("members", &Integrator::members);
}

}  // namespace pipedyn
