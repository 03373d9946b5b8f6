// SPDX-License-Identifier: MIT
//
// What a linear model, P(lambda, u) x = 0 with P = lambda^2 M + lambda C(u) + K(u), gives at a flow
// speed: its lowest roots, the root next to a guess, and where its stiffness is singular. The
// search for crossings (crossings.hpp) and root loci (tracking.hpp) need nothing else. One spectrum
// serves one thread at a time.
//
// With a loss factor mu K is complex, K + i mu K_el, and P that of motions with Im lambda > 0: the
// others are their conjugates. All roots of this P are here, as they move smoothly with u, and not
// their conjugates; of those with Im lambda <= 0 nothing follows for the pipe.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <complex>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace pipedyn {

using Index = Eigen::Index;
using Complex = std::complex<double>;
using Values = Eigen::ArrayXcd;
using Reals = Eigen::ArrayXd;
using ComplexVector = Eigen::VectorXcd;
using ComplexTable = Eigen::MatrixXcd;  // (dof, count), one vector a column

inline constexpr double eps = std::numeric_limits<double>::epsilon();
/// Relative distance of speeds at which K is singular that are not told apart: a double eigenvalue
/// scatters by the square root of rounding.
inline constexpr double same_speed = 1e-7;
/// Least speed at which K is asked to be singular: at rest it may be.
inline constexpr double least_speed = 1e-5;
inline constexpr double infinite = std::numeric_limits<double>::infinity();

/// |z| where its square neither over- nor underflows; std::abs, which cares, takes ten times as
/// long.
inline double magnitude(Complex z) { return std::sqrt(std::norm(z)); }

/// Why a computation has no answer that can be relied on.
struct NotConverged : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Whether a root is good by its relative residual.
bool has_converged(Complex value, double residual);

/// A root with P x = 0 and y^H P = 0, and how good it is.
struct Pair {
  Complex value;                        // lambda
  ComplexVector right = {}, left = {};  // x and y, unit; empty where they are not known
  double residual = infinite;           // |P x| / (|lambda^2 M x| + |lambda C x| + size |x|)
  double uncertain = infinite;          // how far residual and rounding may have moved lambda
  Complex slope = 0.0;                  // d lambda / du
  Complex by_value = 0.0;               // y^H (dP/dlambda) x

  bool converged() const { return has_converged(value, residual); }
};

/// y^H A x of a root's vectors x and y for the parts A of P and its derivatives.
struct Forms {
  Complex mass, velocity, damping, flux;  // A of M, V, D and A in P = lambda^2 M + lambda (u V + D)
                                          // + K + a u^2 A
  Complex gravity, by_damping;            // dK / dgamma and dD / ddelta
  ComplexVector springs;                  // of a chain dP / dk_j without its damping, (n)
};

/// A speed at which the stiffness K(u) is singular: divergence, whatever the velocities.
struct Divergence {
  double speed, error;
  Pair pair = {};  // null vectors; slope is d kappa / du of the eigenvalue of K that vanishes
  int multiplicity =
      1;  // how many eigenvalues of K vanish there, at speeds that are not told apart
  double inertia = 0.0;  // y^H M x

  /// By how many the real growing roots grow, by d lambda / du = -(y^H K' x) / (y^H C x); 0 where
  /// that does not say it, as of conservative pipes, whose roots at zero are double.
  int change() const;
  /// y^H K(0) x / y^H M x, the square of a frequency at rest, as K(speed) x = 0.
  double rest_square() const { return -0.5 * speed * pair.slope.real() / inertia; }
  /// How far from it, at least, the root that passes zero is as far from that as `size`; infinite
  /// where no vectors are known.
  double distance(double size) const;
};

/// All of them up to a speed, ascending.
struct Divergences {
  int negative_at_rest = 0;  // eigenvalues < 0 of K at rest, where K is symmetric at every speed
  std::vector<Divergence> all = {};
  bool complete = true;  // whether there are no others up to where was asked
};

/// Several roots, of each what is known; tables have no columns, and arrays no entries, of what is
/// not.
struct Pairs {
  Values values = {};                   // lambda, (r)
  ComplexTable right = {}, left = {};   // (dof, r)
  Reals residual = {}, uncertain = {};  // as of a `Pair`
  Values slopes = {}, by_left = {},
         by_right = {};     // the latter y^H P' x, x^H P' x, P' = dP/dlambda
  Values corrections = {};  // of lambda by its vectors, 0 where they say no more than rounding
  Reals noise = {};         // how far rounding may have moved lambda, to search by
  Reals slope_noise = {};   // the same of Re d lambda / du; beyond rest 0 where it does not matter,
                            // since lambda itself is no better known
  /// Krein's, -1 or 1, on the imaginary axis of a conservative system, 0 elsewhere: two roots of
  /// one signature pass through each other and stay on the axis.
  Reals signatures = {};

  Index size() const { return values.size(); }
  Pair pair(Index i) const;
  /// Puts one of others, with all that is known of it, at place k.
  void put(Index k, const Pairs& others, Index i);
  Pairs take(const std::vector<Index>& which) const;
};

/// Places of values by |lambda|, of conjugates the upper first; the last do not hold numbers.
std::vector<Index> by_size(const Values& values);

/// The lowest roots at one speed, sorted by |lambda|, of conjugates the upper first. lambda is
/// finite, and slopes are 0 where there are none.
struct Sample : Pairs {
  double u;
};

/// Of a model, the same at every speed.
struct Traits {
  Index dof;
  double delta;       // Kelvin-Voigt damping, whose overdamped roots cluster at -(1 + i mu) / delta
  double zero;        // |lambda| below which a root counts as zero
  bool damped;        // whether any force but the flow's takes energy
  bool conservative;  // whether roots come in fours, lambda, -lambda and conjugates, by symmetry
  bool squared;       // whether lambda enters only as lambda^2
  bool free_at_rest;  // whether it does at u = 0
  double loss = 0.0;  // mu

  bool lossy() const { return loss > 0.0; }
  /// Whether a root is the pipe's.
  bool counts(Complex value) const { return !lossy() || value.imag() > 0.0; }
  /// delta of the cluster, complex with a loss factor.
  Complex cluster() const { return delta / Complex(1.0, loss); }
};

class Spectrum {
 public:
  explicit Spectrum(const Traits& known) : traits(known) {}
  virtual ~Spectrum() = default;

  /// The `count` roots of least |lambda|; all if there are no more. Throws NotConverged where
  /// doubles do not hold them.
  virtual Sample sample(double u, Index count) = 0;

  /// Takes from another what is the same to the bit and need not be computed again.
  virtual void share(const Spectrum&) {}

  /// y^H A x of a root's vectors, where the model is made of parts that are known here.
  virtual std::optional<Forms> forms(const Pair&) const { return {}; }

  /// Steps in u above this are halved unseen, of a pipe without weight. Measured on 52 undamped
  /// pipes of 20 functions up to u = 20: 72 eigenproblems and refinements a sweep; 98 with steps of
  /// 0.5, and 64 and 62 with 1.5 and 2, which are ambiguous and halved anyway. Near -1 / delta,
  /// where roots of many modes meet, shorter steps are needed to tell which is which: where the
  /// fastest root followed is so far from there, no root comes near.
  double longest_step(const Values& at_rest) const {
    const Index last = at_rest.size() - 1;
    return last >= 0 && traits.delta * magnitude(at_rest[last]) > 0.5 ? 0.5 : 1.0;
  }

  /// How many roots are zero, exactly, at every speed.
  virtual Index standing() { return 0; }

  /// The roots at a speed that continue those of a sample, conjugates together, without vectors;
  /// none where they are not found, or not faster than all.
  virtual std::optional<Sample> near(double, const Sample&) { return {}; }

  /// The root next to a guess, of which value and, if known, right vector are used; with vectors.
  virtual Pair refined(double u, const Pair& guess) = 0;

  /// Rayleigh's quotients x^H K x / x^H M x of roots' vectors at a speed: at rest the square of the
  /// frequency that a mode would have without damping, the same for both its roots where damping
  /// leaves its shape. Those of undamped roots, which need no vectors, are -lambda^2.
  virtual Reals quotients(double u, const Pairs& pairs) = 0;

  /// Every speed in (0, max_speed] at which K is singular, from K alone, all at once: no root is
  /// followed. first: whether those beyond the lowest two may be left out. Throws NotConverged
  /// where rounding hides whether there is one.
  virtual Divergences divergences(double max_speed, bool first) = 0;

  /// The problem whose real roots are the pipe's: a loss factor acts on oscillation alone, so with
  /// one they are those of the pipe without it.
  virtual Spectrum& without_loss() { return without_loss_ == nullptr ? *this : *without_loss_; }
  void set_without_loss(std::shared_ptr<Spectrum> other) { without_loss_ = std::move(other); }

  /// Matrices factorised since the last call, an eigenvalue problem being one.
  int factorisations() {
    const int others = without_loss_ == nullptr ? 0 : without_loss_->factorisations();
    return std::exchange(factorised_, 0) + others;
  }

  const Traits traits;

 protected:
  int factorised_ = 0;

 private:
  std::shared_ptr<Spectrum> without_loss_;
};

}  // namespace pipedyn
