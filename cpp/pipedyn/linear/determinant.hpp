// SPDX-License-Identifier: MIT
//
// What a search for roots of a determinant needs of a model whose P(lambda, u) is eliminated along
// the pipe, in O(dof) for each lambda. Two models have it: a chain (chain/dynamic_stiffness.hpp)
// and a reduced model in Legendre curvatures (galerkin/elimination.hpp).
#pragma once

#include <Eigen/SparseCore>
#include <memory>
#include <optional>
#include <utility>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/panel_pencil.hpp"
#include "pipedyn/linear/complement.hpp"
#include "pipedyn/linear/operator.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

/// lambda at which roots at zero are counted and their equations solved. There a joint that nothing
/// holds gives a pivot of the order of lambda or lambda^2 with all its digits, and no other root is
/// as small, as rounding moves each by far more.
inline constexpr double beside_zero = 1e-30;

/// A determinant at each of some speeds: the derivative of its logarithm by the speed and, at real
/// speeds, its sign.
struct StaticDeterminants {
  Values slope;
  Reals sign;
};

class Determinant {
 public:
  explicit Determinant(const Lapack& known) : lapack(known) {}
  virtual ~Determinant() = default;

  /// Number of segments or functions; `coarser` has fewer of them.
  virtual Index size() const = 0;
  /// Number of coordinates that supports take away.
  virtual Index held() const = 0;
  /// Number of functions or segments with which this many roots can be computed.
  virtual Index enough_for(Index roots) const = 0;
  virtual std::unique_ptr<Determinant> coarser(Index size) const = 0;

  /// d log det P / dlambda - sum_k 1 / (lambda - lambda_k) over the known roots, without known
  /// roots at lambda itself. The second form writes them to `found`.
  Values log_derivatives(double u, const ValuesRef& at, const ValuesRef& known) const {
    Values found(at.size());
    log_derivatives(u, at, known, found);
    return found;
  }
  void log_derivatives(double u, const ValuesRef& at, const ValuesRef& known,
                       Eigen::Ref<Values> found) const;
  /// Writes errors, slopes and corrections of roots from their vectors to `found`, and unit vectors
  /// if they are asked for. own: whether by_right is needed; loaded: see `PairsAsked`; places:
  /// which entries of `found` to replace, instead of the first ones, for which it grows.
  void pairs(double u, const ValuesRef& values, bool vectors, bool own, bool loaded, Pairs& found,
             const std::vector<Index>& places = {}) const;
  /// A sum of parts of P as a matrix in elastic coordinates, (dof, dof), and the norm of the
  /// numbers whose rounding it has.
  virtual std::pair<Matrix, double> matrix(const LinearPart& part) const = 0;
  /// The matrices of P in elastic coordinates. stiffness_size: size of K at rest.
  Pencil matrices(double stiffness_size) const;
  /// P at rest of a pipe without damping: M and K alone.
  DenseOperator free_at_rest() const {
    return {lapack, {matrix({.mass = 1.0}).first, {}, matrix({.stiffness = 1.0}).first}, 1.0, {}};
  }
  /// Whether elimination pivots: vectors are then as accurate where a part of the pipe is singular
  /// by itself.
  virtual bool is_pivoted() const = 0;
  /// Whether roots may be zero because nothing holds a joint or the root of the pipe.
  virtual bool turns_freely() const = 0;

  /// y^H A x of a pair's vectors for the parts A of P.
  Forms forms(const Pair& pair) const;
  /// y^H (dP/dlambda) x of the vectors of pairs.
  Values by_lambda(double u, const Pairs& pairs) const;
  /// Work on vectors (dof, r) that oscillate with some frequencies, if it is known without
  /// differences of nearly equal numbers.
  virtual std::optional<Rayleigh> rayleigh(double, const Reals&, const ComplexTable&) const {
    return {};
  }
  /// Rayleigh quotients x^H K x / x^H M x of vectors (dof, r).
  Reals quotients(double u, const ComplexTable& vectors) const;

  /// The numbers of the model, as in `Spectrum::numbers`.
  virtual std::vector<double> numbers() const { return {}; }

  /// a, the factor of u^2 in K(u).
  virtual double thrust() const = 0;
  /// det K(u) at real or complex speeds, or det P(beside_zero, u) where joints turn freely.
  virtual StaticDeterminants static_determinants(const Values& u) const = 0;
  /// Number of negative eigenvalues of K at rest, where K is symmetric.
  virtual int negative_at_rest() const = 0;

  /// Takes over the memory of a determinant that is not evaluated any more.
  void reuse(const Determinant& other) const {
    room_.swap(other.room_);
    projected_.swap(other.projected_);
  }

  const Lapack lapack;

 protected:
  /// Calls the kernel that computes `log_derivatives`, or the one that computes `pairs`.
  virtual void evaluate(const Points& points, double* out) const = 0;
  virtual void evaluate(const Points& points, const PairsAsked& out) const = 0;
  /// Takes vectors in the coordinates of the kernel, (size, r), to elastic coordinates, in the
  /// memory of `to`.
  virtual Eigen::Map<Matrix> project(const Eigen::Map<Matrix>& x, Matrix& to) const = 0;
  /// Takes vectors in elastic coordinates, (dof, r), to the coordinates in which `times` knows
  /// products.
  virtual Matrix lifted(const Matrix& x) const = 0;
  virtual Matrix times(const Matrix& x, const LinearPart& part) const = 0;
  virtual double hysteresis() const = 0;
  /// Error of every entry of a matrix by rounding, relative to the entry.
  virtual double entries_lost() const { return eps; }
  /// Whether the coordinates of `times` are joint angles, where each joint has a spring of its own.
  virtual bool has_joints() const = 0;

 private:
  double* room(Index count) const;
  ComplexTable lifted(const ComplexTable& x) const;
  /// y^H A x of each column of y and of x, in the coordinates of `times`.
  Values inner(const ComplexTable& y, const ComplexTable& x, const LinearPart& part) const;

  mutable std::vector<double> room_;  // numbers that kernels read and write
  mutable Matrix projected_;          // vectors in elastic coordinates, in real and imaginary parts
};

class ChainDeterminant : public Determinant {
 public:
  /// complement: basis of the elastic coordinates that guides leave free.
  ChainDeterminant(std::shared_ptr<const Chain> chain, Complement complement, const Lapack& known)
      : Determinant(known),
        chain_(std::move(chain)),
        scale_(chain_->elastic_scale()),
        complement_(std::move(complement)) {}

  Index size() const override { return chain_->dof(); }
  Index held() const override { return chain_->dof() - complement_.dof(); }
  Index enough_for(Index roots) const override;
  std::unique_ptr<Determinant> coarser(Index size) const override;
  std::pair<Matrix, double> matrix(const LinearPart& part) const override;
  bool is_pivoted() const override { return false; }
  bool turns_freely() const override { return chain_->turns_freely(); }
  std::vector<double> numbers() const override;
  double thrust() const override { return chain_->model().thrust[0]; }
  StaticDeterminants static_determinants(const Values& u) const override;
  int negative_at_rest() const override;

 protected:
  void evaluate(const Points& points, double* out) const override {
    motion_kernel().dynamic_stiffness->log_derivative(chain_->model(), points, out);
  }
  void evaluate(const Points& points, const PairsAsked& out) const override {
    motion_kernel().dynamic_stiffness->pairs(chain_->model(), points, out);
  }
  Eigen::Map<Matrix> project(const Eigen::Map<Matrix>& angles, Matrix& to) const override {
    auto found = room_in(to, angles.rows(), angles.cols());
    found = scale_.cwiseInverse().asDiagonal() * angles;
    if (held() == 0) return found;
    complement_.project(found);
    return {found.bottomRows(complement_.dof()).data(), complement_.dof(), found.cols()};
  }
  Matrix lifted(const Matrix& x) const override {
    return scale_.asDiagonal() * complement_.lifted(x);
  }
  Matrix times(const Matrix& x, const LinearPart& part) const override {
    return chain_->joint_times(x, part);
  }
  double hysteresis() const override { return chain_->pipe().hysteresis; }
  bool has_joints() const override { return true; }

 private:
  std::shared_ptr<const Chain> chain_;
  Vector scale_;  // joint angles per elastic coordinate, (n)
  Complement complement_;
};

class PanelDeterminant : public Determinant {
 public:
  /// lift: takes a model's elastic coordinates to those of the pencil, (size, dof); projection:
  /// takes those of the pencil back.
  PanelDeterminant(std::shared_ptr<const PanelPencil> pencil, const Lapack& known,
                   const Matrix& lift, const Matrix& projection)
      : Determinant(known),
        pencil_(std::move(pencil)),
        lift_(lift.sparseView()),
        projection_(projection.sparseView()) {}

  Index size() const override { return pencil_->size(); }
  Index held() const override { return pencil_->conditions(); }
  Index enough_for(Index roots) const override;
  std::unique_ptr<Determinant> coarser(Index size) const override;
  std::pair<Matrix, double> matrix(const LinearPart& part) const override;
  bool is_pivoted() const override { return true; }
  bool turns_freely() const override { return pencil_->pipe().root == 0.0; }
  double thrust() const override { return pencil_->pipe().end_coefficient; }
  StaticDeterminants static_determinants(const Values& u) const override;
  int negative_at_rest() const override;
  std::optional<Rayleigh> rayleigh(double u, const Reals& frequencies,
                                   const ComplexTable& vectors) const override;

 protected:
  void evaluate(const Points& points, double* out) const override {
    motion_kernel().elimination->log_derivative(at(points.u).model, points, out, nullptr);
  }
  void evaluate(const Points& points, const PairsAsked& out) const override {
    motion_kernel().elimination->pairs(at(points.u).model, points, out);
  }
  Eigen::Map<Matrix> project(const Eigen::Map<Matrix>& x, Matrix& to) const override {
    auto found = room_in(to, projection_.rows(), x.cols());
    found.noalias() = projection_ * x;
    return found;
  }
  Matrix lifted(const Matrix& x) const override { return lift_ * x; }
  Matrix times(const Matrix& x, const LinearPart& part) const override {
    return pencil_->times(x, part);
  }
  double hysteresis() const override { return pencil_->pipe().hysteresis; }
  double entries_lost() const override;
  bool has_joints() const override { return false; }

 private:
  const PanelPencil::At& at(double u) const;
  /// K + s A, as a function of s, the square of the speed.
  const EliminationModel& stiffness() const;

  std::shared_ptr<const PanelPencil> pencil_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> lift_, projection_;  // most columns have one entry
  mutable double latest_speed_ = -1.0;
  mutable PanelPencil::At latest_;
  mutable std::optional<PanelPencil::At> static_;  // set when it is first asked for
};

}  // namespace pipedyn
