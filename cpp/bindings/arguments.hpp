// SPDX-License-Identifier: MIT
//
// Checks of states and speeds that come from Python. They raise TypeError for what is no array of
// real numbers, and ValueError for a wrong shape, NaN, infinity or a speed out of range. Each
// message names the argument, the rule and what came.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/typing.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/pipe.hpp"
#include "pipedyn/util/threads.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace py = pybind11;

using Numbers = py::array_t<double, py::array::c_style>;

constexpr double highest_speed = 1e100;  // its square is finite

inline std::string shape_of(const py::array& array) { return py::repr(array.attr("shape")); }

/// The argument as contiguous numbers. An array of such numbers is taken without a copy; lists,
/// other types of numbers and other layouts are read by the package's check in Python, which
/// refuses masked arrays and booleans.
inline Numbers numbers_argument(const char* name, const char* kind, py::handle value) {
  const auto& api = py::detail::npy_api::get();
  const bool plain = Py_TYPE(value.ptr()) == api.PyArray_Type_;  // no masked array, for one
  if (plain && Numbers::check_(value)) return py::reinterpret_borrow<Numbers>(value);
  return py::module_::import("pipedyn.util.check").attr("doubles")(name, value, kind);
}

inline void require_size(const char* name, const Numbers& array, py::ssize_t size) {
  if (array.size() == size) return;
  throw py::value_error(std::string(name) + " must hold " + std::to_string(size) +
                        " numbers, got shape " + shape_of(array));
}

inline bool all_finite(const double* x, py::ssize_t count) {
  return (0.0 * Eigen::Map<const Vector>(x, count)).sum() == 0.0;  // an entry is 0, or else NaN
}

inline void require_finite(const char* name, const Numbers& array) {
  const double* const data = array.data();
  const py::ssize_t count = array.size();
  if (all_finite(data, count)) return;
  py::ssize_t at = 0;
  while (std::isfinite(data[at])) ++at;
  std::string index = std::to_string(at);
  if (array.ndim() == 2) {
    const py::ssize_t columns = array.shape(1);
    index = "(" + std::to_string(at / columns) + ", " + std::to_string(at % columns) + ")";
  }
  throw py::value_error(std::string(name) + " must be finite, got " +
                        std::string(py::repr(py::float_(data[at]))) + " at index " + index);
}

/// States of a model: one, (rows,), or one in each column, (rows, members).
struct States {
  Numbers values;
  bool one;  // shape (rows,)
  py::ssize_t members;

  States(const char* name, py::handle value, py::ssize_t rows)
      : values(numbers_argument(name, "an array of real numbers", value)),
        one(values.ndim() == 1),
        members(one                  ? 1
                : values.ndim() == 2 ? values.shape(1)
                                     : 0) {
    const bool fits = (one || values.ndim() == 2) && values.shape(0) == rows;
    if (!fits) {
      const std::string size = std::to_string(rows);
      throw py::value_error(std::string(name) + " must have shape (" + size + ",)" + " or (" +
                            size + ", k), got " + shape_of(values));
    }
    require_finite(name, values);
  }
};

/// Flow speeds, one for each member or one for all.
struct Speeds {
  double one = 0.0;
  std::optional<Numbers> each;  // a Numbers made for nothing would cost as much as the call

  /// Takes a number or, for a batch of states, an array (members,) as well.
  Speeds(const char* name, py::handle value, const States& states) {
    if (PyFloat_Check(value.ptr()) || PyLong_CheckExact(value.ptr())) {
      one = PyFloat_AsDouble(value.ptr());
      if (PyErr_Occurred() != nullptr) {  // more than a double holds
        PyErr_Clear();
        one = HUGE_VAL;
      }
    } else {
      each = numbers_argument(
          name, states.one ? "a real number" : "a real number or an array of them", value);
      if (each->ndim() == 0) {
        one = *each->data();
        each.reset();
      } else if (states.one || each->ndim() != 1 || each->shape(0) != states.members) {
        const std::string rule =
            states.one ? "a number"
                       : "a number or have shape (" + std::to_string(states.members) + ",)";
        throw py::value_error(std::string(name) + " must be " + rule + ", got shape " +
                              shape_of(*each));
      }
    }
    if (!each) {
      require_range(name, one, "");
      return;
    }
    for (py::ssize_t j = 0; j < states.members; ++j) {
      const double u = each->data()[j];
      if (!in_range(u)) require_range(name, u, " at index " + std::to_string(j));
    }
  }

  const double* data() const { return each ? each->data() : &one; }
  py::ssize_t step() const { return each ? 1 : 0; }

 private:
  static bool in_range(double u) { return u >= 0.0 && u <= highest_speed; }

  static void require_range(const char* name, double u, const std::string& where) {
    if (in_range(u)) return;
    throw py::value_error(std::string(name) + " must lie in [0, 1e+100], got " +
                          std::string(py::repr(py::float_(u))) + where);
  }
};

/// A new array of shape (rows,) or (rows, columns). It is made by numpy, which is faster than
/// pybind11's constructor with strides.
inline Numbers new_numbers(py::ssize_t rows, py::ssize_t columns, bool one) {
  const auto& api = py::detail::npy_api::get();
  const Py_intptr_t shape[] = {rows, columns};
  PyObject* const made =
      api.PyArray_NewFromDescr_(api.PyArray_Type_, py::dtype::of<double>().release().ptr(),
                                one ? 1 : 2, shape, nullptr, nullptr, 0, nullptr);
  if (made == nullptr) throw py::error_already_set();
  return py::reinterpret_steal<Numbers>(made);
}

using NumberOrArray = py::typing::Union<py::float_, Numbers>;

/// Row i of an array of results (rows,) or (rows, k).
inline NumberOrArray row_of(const Numbers& results, py::ssize_t i) {
  if (results.ndim() == 1) return py::float_(results.data()[i]);
  return results[py::int_(i)];
}

/// Work on a batch, which writes its results.
using Work = std::function<void(const Batch&, double*)>;

/// Does the work on a batch of states (rows, members) in parts. results: numbers that it writes for
/// a member, as a column of (results, members) or, if of_member, one member after the other; each:
/// amount of work for one member.
inline void in_parts(const Batch& batch, Index rows, Index results, bool of_member, Index each,
                     const Work& work, double* out) {
  const Index members = batch.members;
  in_parts(members, each, [&](Index begin, Index end) {
    const Index count = end - begin;
    if (count == members) {
      work(batch, out);
      return;
    }
    const auto columns = [=](const double* of, Index height) -> Matrix {
      if (of == nullptr) return {};
      return Eigen::Map<const Matrix>(of, height, members).middleCols(begin, count);
    };
    const Matrix y = columns(batch.y, rows), drive = columns(batch.drive, batch.drive_rows);
    const Batch part{.y = y.data(),
                     .u = batch.u + begin * batch.u_step,
                     .members = count,
                     .u_step = batch.u_step,
                     .drive = batch.drive == nullptr ? nullptr : drive.data(),
                     .drive_rows = batch.drive_rows};
    if (of_member) {
      work(part, out + begin * results);
      return;
    }
    Matrix found(results, count);
    work(part, found.data());
    Eigen::Map<Matrix>(out, results, members).middleCols(begin, count) = found;
  });
}

using Unlocked = py::call_guard<py::gil_scoped_release>;

/// Releases the interpreter lock if the work takes longer than releasing and acquiring it. amount:
/// of work, where computing one segment's share of a chain's right-hand side is 1.
struct UnlockedFor {
  std::optional<py::gil_scoped_release> unlocked;

  explicit UnlockedFor(py::ssize_t amount) {
    constexpr py::ssize_t worth_it = 64;
    if (amount >= worth_it) unlocked.emplace();
  }
};

/// Results (results,) or (results, k) that `work` computes from states (rows,) or (rows, k), their
/// speeds and drive (Drive::rows or more, k), or None; with `matrices` each result is a matrix
/// (results, rows), and those of k states are (k, results, rows). cost: amount of work for one
/// state, as for `UnlockedFor`.
inline Numbers results_of(py::ssize_t rows, py::ssize_t results, py::ssize_t cost,
                          const py::object& y, const py::object& u, const py::object& drive,
                          const Work& work, bool matrices = false) {
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  std::vector<py::ssize_t> shape{results, rows};
  if (!states.one) shape.insert(shape.begin(), states.members);
  Numbers made = matrices ? Numbers(shape) : new_numbers(results, states.members, states.one);
  Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  std::optional<Numbers> rows_of_drive;
  if (!drive.is_none()) {
    rows_of_drive = numbers_argument("drive", "an array of real numbers", drive);
    const Index size = rows_of_drive->size(), members = std::max<Index>(states.members, 1);
    batch.drive_rows = std::max(size / members, Drive::rows);
    require_size("drive", *rows_of_drive, batch.drive_rows * states.members);
    batch.drive = rows_of_drive->data();
  }
  double* const out = made.mutable_data();
  const UnlockedFor unlocked(cost * states.members);
  work(batch, out);
  return made;
}

/// Raises NotResolved, which says that `what` cannot be computed for the given members of a batch.
[[noreturn]] inline void refuse(const char* what, const std::vector<py::ssize_t>& members,
                                const py::object& states, const std::string& why) {
  const py::object error = py::module_::import("pipedyn.util.errors").attr("NotResolved");
  py::list indices;
  for (const py::ssize_t member : members) indices.append(member);
  PyErr_SetObject(error.ptr(), error.attr("of_states")(what, indices, states, why).ptr());
  throw py::error_already_set();
}

/// Raises NotResolved unless all results for the states (rows, k) are finite. They stand in columns
/// (results, k) or, if of_member, one member after the other.
template <class Model>
void require_answer(const char* what, const Model& of, py::ssize_t rows, const py::object& y,
                    const Numbers& made, bool of_member) {
  const double* const data = made.data();
  if (all_finite(data, made.size())) return;
  const States states("y", y, rows);
  const py::ssize_t k = states.members, each = made.size() / k;
  std::vector<py::ssize_t> members;
  for (py::ssize_t j = 0; j < k; ++j) {
    bool finite = true;
    for (py::ssize_t i = 0; i < each; ++i) {
      finite = finite && std::isfinite(data[of_member ? j * each + i : i * k + j]);
    }
    if (!finite) members.push_back(j);
  }
  std::string why;
  if constexpr (requires { of.unresolved(states.values.data(), k); }) {
    why = of.unresolved(states.values.data() + members.front(), k);
  }
  refuse(what, members, states.one ? py::object(py::none()) : py::int_(k), why);
}

/// Powers (flow, joints, drag, others, base) of each member.
using Parts =
    py::typing::Tuple<NumberOrArray, NumberOrArray, NumberOrArray, NumberOrArray, NumberOrArray>;

/// Defines the equations of motion for states [p, p'] with 2 dof rows. work_of: amount of work for
/// one state, as for `UnlockedFor`. Results that the model does not resolve raise NotResolved if
/// `refuses`, and are NaN otherwise, as integrators and searches take them.
template <class Model, py::ssize_t (*work_of)(const Model&)>
void define_equations(auto& model) {
  using namespace py::literals;
  using py::object;
  // Results for states of `rows` rows by a member function of the model, in parts; see results_of.
  // refused: name of the results if NaN among them is refused, else null.
  const auto ask = [](const Model& of, const object& y, const object& u, const object& drive,
                      py::ssize_t rows, py::ssize_t results, auto work,
                      const char* refused = nullptr, bool matrices = false) {
    const py::ssize_t cost = (matrices ? rows : 1) * work_of(of);
    const py::ssize_t each = matrices ? results * rows : results;
    const auto part = [&](const Batch& batch, double* out) { std::invoke(work, of, batch, out); };
    const auto all = [&](const Batch& batch, double* out) {
      in_parts(batch, rows, each, matrices, cost, part, out);
    };
    Numbers made = results_of(rows, results, cost, y, u, drive, all, matrices);
    if (refused != nullptr) require_answer(refused, of, rows, y, made, matrices);
    return made;
  };
  const auto drive = "drive"_a = py::none(), refuses = "refuses"_a = true;
  model
      .def(
          "rhs",
          [ask](const Model& of, const object&, const object& y, const object& u,
                const object& driven, bool refused, bool works) {
            const py::ssize_t rows = 2 * of.dof() + works;
            return ask(of, y, u, driven, rows, rows, works ? &Model::rhs_and_power : &Model::rhs,
                       refused ? "rhs" : nullptr);
          },
          "t"_a, "y"_a, "u"_a, drive, refuses, "works"_a = false)
      .def(
          "jacobian",
          [ask](const Model& of, const object&, const object& y, const object& u,
                const object& driven, bool refused) {
            const py::ssize_t rows = 2 * of.dof();
            const char* const name = refused ? "jacobian" : nullptr;
            return ask(of, y, u, driven, rows, rows, &Model::jacobian, name, true);
          },
          "t"_a, "y"_a, "u"_a, drive, refuses)
      .def(
          "energy",
          [ask](const Model& of, const object& y, const object& driven, bool refused) {
            return row_of(ask(of, y, py::float_(0.0), driven, 2 * of.dof(), 1, &Model::energy,
                              refused ? "energy" : nullptr),
                          0);
          },
          "y"_a, drive, refuses)
      .def(
          "power",
          [ask](const Model& of, const object& y, const object& u, const object& driven) -> Parts {
            const Numbers parts = ask(of, y, u, driven, 2 * of.dof(), 5, &Model::power, "power");
            return py::make_tuple(row_of(parts, 0), row_of(parts, 1), row_of(parts, 2),
                                  row_of(parts, 3), row_of(parts, 4));
          },
          "y"_a, "u"_a, drive);
  if constexpr (requires { &Model::axial; }) {
    model.def(
        "axial",
        [ask](const Model& of, const object& y, const object& driven) {
          const py::ssize_t n = of.dof();
          return ask(of, y, py::float_(0.0), driven, 3 * n, 2 + 4 * n, &Model::axial);
        },
        "y"_a, drive);
  }
  if constexpr (requires { &Model::linearise; }) {
    model.def(
        "linearised",
        [ask](const Model& of, const object& y, const object& u, const object& driven) {
          const py::ssize_t rows = 2 * of.dof();
          return ask(of, y, u, driven, rows, 2 + rows, &Model::linearise, nullptr, true);
        },
        "y"_a, "u"_a, drive);
  }
}

/// The routines of LAPACK in SciPy; see linear.cpp.
struct Lapack;
const Lapack& scipy_lapack();

/// Defines eigenproblems, spectra and searches; see linear.cpp.
void define_linear(py::module_& m);

/// Defines the integrators in time; see motion.cpp.
void define_motion(py::module_& m);

/// Defines the collocation of periodic orbits; see orbits.cpp.
void define_orbits(py::module_& m);

/// Defines the class Scene; see scene.cpp.
void define_scene(py::module_& m);

}  // namespace pipedyn
