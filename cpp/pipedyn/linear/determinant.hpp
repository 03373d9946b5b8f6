// SPDX-License-Identifier: MIT
//
// What a search for roots of a determinant needs of a model whose P(lambda, u) is eliminated along
// the pipe, in O(dof) for each lambda. Two models have it: a chain (chain/impedance.hpp) and a
// reduced model in Legendre curvatures (galerkin/elimination.hpp).
#pragma once

#include <Eigen/SparseCore>
#include <memory>
#include <optional>
#include <utility>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/panel_pencil.hpp"
#include "pipedyn/linear/complement.hpp"
#include "pipedyn/linear/operator.hpp"

namespace pipedyn {

/// lambda at which roots at zero are counted and their equations solved. There a joint that nothing
/// holds gives a pivot of the order of lambda or lambda^2 with all its digits, and no other root is
/// as small, as rounding moves each by far more.
inline constexpr double beside_zero = 1e-30;

/// A real determinant at each of some speeds: its sign, the logarithm of its absolute value, and
/// the derivative of that logarithm by the speed.
struct StaticDeterminants {
  Reals sign, logarithm, slope;
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
  /// roots at lambda itself.
  virtual Values log_derivatives(double u, const Values& at, const Values& known) const = 0;
  /// Errors, slopes and corrections of roots from their vectors, and unit vectors if they are asked
  /// for. own: whether by_right is needed; loaded: see `PairsAsked`.
  virtual Pairs pairs(double u, const Values& values, bool vectors, bool own,
                      bool loaded) const = 0;
  /// The matrices of P in elastic coordinates. stiffness_size: size of K at rest.
  virtual Pencil matrices(double stiffness_size) const = 0;
  virtual bool has_loss() const = 0;
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
  virtual std::optional<Works> works(double, const Reals&, const ComplexTable&) const { return {}; }
  /// x^H A x of vectors (dof, r) with A = K(u) and with A = M.
  std::pair<Reals, Reals> energies(double u, const ComplexTable& x) const;

  /// a, the factor of u^2 in K(u).
  virtual double thrust() const = 0;
  /// Derivative by the speed of the logarithm of det K(u), at complex speeds.
  virtual Values static_slopes(const Values& u) const = 0;
  /// det K(u), or det P(beside_zero, u) where joints turn freely.
  virtual StaticDeterminants static_determinants(const Reals& u) const = 0;
  /// Number of negative eigenvalues of K at rest, where K is symmetric.
  virtual int negative_at_rest() const = 0;

  const Lapack lapack;

 protected:
  /// Takes vectors in elastic coordinates, (dof, r), to the coordinates in which `times` knows
  /// products.
  virtual Matrix spread(const Matrix& x) const = 0;
  virtual Matrix times(const Matrix& x, const LinearPart& part) const = 0;
  /// Whether the coordinates of `times` are joint angles, where each joint has a spring of its own.
  virtual bool has_joints() const = 0;
};

class ChainDeterminant : public Determinant {
 public:
  /// complement: basis of the elastic coordinates that guides leave free; scale: joint angles per
  /// elastic coordinate, (n).
  ChainDeterminant(std::shared_ptr<const Chain> chain, std::shared_ptr<const Complement> complement,
                   const Lapack& known, Vector scale)
      : Determinant(known),
        chain_(std::move(chain)),
        complement_(std::move(complement)),
        scale_(std::move(scale)) {}

  Index size() const override { return chain_->dof(); }
  Index held() const override { return chain_->dof() - complement_->dof(); }
  Index enough_for(Index roots) const override;
  std::unique_ptr<Determinant> coarser(Index size) const override;
  Values log_derivatives(double u, const Values& at, const Values& known) const override;
  Pairs pairs(double u, const Values& values, bool vectors, bool own, bool loaded) const override;
  Pencil matrices(double stiffness_size) const override;
  bool is_pivoted() const override { return false; }
  bool has_loss() const override { return chain_->pipe().hysteresis > 0.0; }
  bool turns_freely() const override { return chain_->springs().minCoeff() <= 0.0; }
  double thrust() const override { return chain_->impedance().thrust; }
  Values static_slopes(const Values& u) const override;
  StaticDeterminants static_determinants(const Reals& u) const override;
  int negative_at_rest() const override;

 protected:
  Matrix spread(const Matrix& x) const override {
    return scale_.asDiagonal() * complement_->spread(x);
  }
  Matrix times(const Matrix& x, const LinearPart& part) const override {
    return chain_->joint_times(x, part);
  }
  bool has_joints() const override { return true; }

 private:
  std::shared_ptr<const Chain> chain_;
  std::shared_ptr<const Complement> complement_;
  Vector scale_;
};

class PanelDeterminant : public Determinant {
 public:
  /// spread: takes a model's elastic coordinates to those of the pencil, (size, dof); gathered:
  /// takes those of the pencil back.
  PanelDeterminant(std::shared_ptr<const PanelPencil> pencil, const Lapack& known,
                   const Matrix& spread, const Matrix& gathered)
      : Determinant(known),
        pencil_(std::move(pencil)),
        spread_(spread.sparseView()),
        gathered_(gathered.sparseView()) {}

  Index size() const override { return pencil_->size(); }
  Index held() const override { return pencil_->conditions(); }
  Index enough_for(Index roots) const override;
  std::unique_ptr<Determinant> coarser(Index size) const override;
  Values log_derivatives(double u, const Values& at, const Values& known) const override;
  Pairs pairs(double u, const Values& values, bool vectors, bool own, bool loaded) const override;
  Pencil matrices(double stiffness_size) const override;
  bool is_pivoted() const override { return true; }
  bool has_loss() const override { return pencil_->pipe().hysteresis > 0.0; }
  bool turns_freely() const override { return pencil_->pipe().root == 0.0; }
  double thrust() const override { return pencil_->pipe().end_coefficient; }
  Values static_slopes(const Values& u) const override;
  StaticDeterminants static_determinants(const Reals& u) const override;
  int negative_at_rest() const override;
  std::optional<Works> works(double u, const Reals& frequencies,
                             const ComplexTable& vectors) const override;

 protected:
  Matrix spread(const Matrix& x) const override { return spread_ * x; }
  Matrix times(const Matrix& x, const LinearPart& part) const override {
    return pencil_->times(x, part);
  }
  bool has_joints() const override { return false; }

 private:
  const PanelPencil::At& at(double u) const;
  /// K + s A, as a function of s, the square of the speed.
  const EliminationModel& stiffness() const;

  std::shared_ptr<const PanelPencil> pencil_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> spread_, gathered_;  // most columns have one entry
  mutable double latest_speed_ = -1.0;
  mutable PanelPencil::At latest_;
  mutable std::optional<PanelPencil::At> static_;  // set when it is first asked for
};

}  // namespace pipedyn
