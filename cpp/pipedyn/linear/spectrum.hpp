// SPDX-License-Identifier: MIT
//
// What a linear model, P(lambda, u) x = 0 with P = lambda^2 M + lambda C(u) + K(u), gives at a flow
// speed: its lowest roots, the root next to a guess, and the speeds at which its stiffness is
// singular. The search for crossings (crossings.hpp) and root loci (tracking.hpp) need nothing
// else. A spectrum must not be used by two threads at a time.
//
// With a loss factor mu the stiffness is complex, K + i mu K_el, and P is that of motions with Im
// lambda > 0; the other motions are their conjugates. A spectrum has all roots of this P, as they
// move smoothly with u, and not their conjugates. Its roots with Im lambda <= 0 are not roots of
// the pipe.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <complex>
#include <cstdio>
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
using ValuesRef = Eigen::Ref<const Values>;
using Reals = Eigen::ArrayXd;
using ComplexVector = Eigen::VectorXcd;
using ComplexTable = Eigen::MatrixXcd;  // (dof, count), one vector a column

inline constexpr double eps = std::numeric_limits<double>::epsilon();
/// Relative distance below which two speeds at which K is singular are not told apart: a double
/// eigenvalue scatters by the square root of rounding.
inline constexpr double same_speed = 1e-7;
/// Least speed at which K is tested for being singular, since at rest it may be.
inline constexpr double least_speed = 1e-5;
inline constexpr double infinite = std::numeric_limits<double>::infinity();

/// |z| for numbers whose square neither overflows nor underflows. std::abs, which avoids both,
/// takes ten times as long.
inline double magnitude(Complex z) { return std::sqrt(std::norm(z)); }

/// Tells why a computation has no answer that can be relied on.
struct NotConverged : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// An exception with a message in printf's format.
template <class... Numbers>
NotConverged not_converged(const char* format, Numbers... numbers) {
  char text[200];
  std::snprintf(text, sizeof text, format, numbers...);
  return NotConverged(text);
}

/// Whether the relative residual of a root passes the check.
bool has_converged(Complex value, double residual);

/// A root lambda with its vectors, P x = 0 and y^H P = 0, and its errors.
struct Pair {
  Complex value;                        // lambda
  ComplexVector right = {}, left = {};  // unit vectors x, y; empty where not known
  double residual = infinite;           // |P x| / (|lambda^2 M x| + |lambda C x| + size |x|)
  double uncertain = infinite;          // how far lambda may be off, by residual and rounding
  Complex slope = 0.0;                  // d lambda / du
  Complex by_value = 0.0;               // y^H (dP/dlambda) x

  bool converged() const { return has_converged(value, residual); }
};

/// The numbers y^H A x of a root's vectors x and y, where A are the parts of P and of its
/// derivatives.
struct Forms {
  Complex mass, velocity, damping, flux;  // A of M, V, D and A in P = lambda^2 M + lambda (u V + D)
                                          // + K + a u^2 A
  Complex gravity, by_damping;            // dK / dgamma and dD / ddelta
  ComplexVector springs;                  // for a chain dP / dk_j without its damping, (n)
};

/// A speed at which the stiffness K(u) is singular: divergence, whatever the terms in the velocity
/// are.
struct Divergence {
  double speed, error;
  Pair pair = {};        // null vectors; slope: d kappa / du of the eigenvalue kappa = 0 of K
  int multiplicity = 1;  // number of eigenvalues of K that vanish at speeds not told apart
  double inertia = 0.0;  // y^H M x

  /// Change of the number of growing real roots, by d lambda / du = -(y^H K' x) / (y^H C x). It is
  /// 0 where this formula does not tell, for instance for conservative pipes, whose roots at zero
  /// are double.
  int change() const;
  /// y^H K(0) x / y^H M x, the square of a frequency at rest; it follows from K(speed) x = 0.
  double rest_square() const { return -0.5 * speed * pair.slope.real() / inertia; }
  /// Least distance from this speed at which the root that passes zero has the magnitude `size`;
  /// infinite where no vectors are known.
  double distance(double size) const;
};

/// All divergences up to a speed, in ascending order.
struct Divergences {
  int negative_at_rest = 0;  // number of eigenvalues < 0 of K at rest, if K is symmetric at all u
  std::vector<Divergence> all = {};
  double known_to = infinite;  // speed beyond which there may be others, before the speed asked for
};

/// Several roots, with what is known of each. A table of what is not known has no columns, and an
/// array of it no entries.
struct Pairs {
  Values values = {};                   // lambda, (r)
  ComplexTable right = {}, left = {};   // (dof, r)
  Reals residual = {}, uncertain = {};  // as in `Pair`
  Values slopes = {}, by_left = {},
         by_right = {};     // by_left = y^H P' x, by_right = x^H P' x, P' = dP/dlambda
  Values corrections = {};  // corrections of lambda by its vectors, 0 within rounding
  Reals noise = {};         // how far rounding may have moved lambda; searches use it
  /// How far rounding may have moved Re d lambda / du. Beyond rest it is 0 where it does not
  /// matter, since lambda itself is no better known.
  Reals slope_noise = {};
  /// Krein signature, -1 or 1, of roots on the imaginary axis of a conservative system, and 0 for
  /// others: two roots of one signature pass through each other and stay on the axis.
  Reals signatures = {};

  Index size() const { return values.size(); }
  auto converged() const {
    return values.binaryExpr(residual,
                             [](Complex z, double lost) { return has_converged(z, lost); });
  }
  Pair pair(Index i) const;
  /// Lets the memory of all numbers of a root, without vectors, grow to that of so many roots.
  void make_room(Index count);
  /// Replaces entry k by entry i of others, with all that is known of that.
  void put(Index k, const Pairs& others, Index i);
  /// Writes the entries `which` to others, whose memory serves again.
  void take(const std::vector<Index>& which, Pairs& to) const;
};

/// Indices of values in the order of |lambda|, with the upper of two conjugates first; values that
/// are not numbers come last. They are written to the memory of `order`.
std::vector<Index> by_size(const ValuesRef& values, std::vector<Index> order = {});

/// The lowest roots at one speed, sorted by |lambda|, with the upper of two conjugates first.
/// lambda is finite, and slopes are 0 where none exist.
struct Sample : Pairs {
  double u = 0.0;
};

/// Properties of a model that are the same at every speed.
struct Traits {
  Index dof;
  double delta;       // Kelvin-Voigt damping, whose overdamped roots cluster at -(1 + i mu) / delta
  double zero;        // |lambda| below which a root counts as zero
  bool damped;        // whether a force other than the flow's takes energy
  bool conservative;  // whether roots come in fours, by symmetry: lambda, -lambda, conjugates
  bool squared;       // whether lambda enters only as lambda^2
  bool free_at_rest;  // whether lambda enters only as lambda^2 at u = 0
  double loss = 0.0;  // loss factor mu

  bool is_hysteretic() const { return loss > 0.0; }
  /// Whether a root of P is a root of the pipe.
  bool counts(Complex value) const { return !is_hysteretic() || value.imag() > 0.0; }
  /// delta of the cluster at -1 / delta; complex with a loss factor.
  Complex cluster() const { return delta / Complex(1.0, loss); }
};

class Spectrum {
 public:
  explicit Spectrum(const Traits& known) : traits(known) {}
  virtual ~Spectrum() = default;

  /// Writes the `count` roots of least |lambda|, or all roots if there are no more, to a sample,
  /// whose memory serves again. Throws NotConverged where a root is beyond double precision.
  virtual void sample(double u, Index count, Sample& at) = 0;

  /// A sample of this spectrum that nobody refers to any more, or a new one.
  std::shared_ptr<Sample> unused_sample() {
    for (const std::shared_ptr<Sample>& one : samples_) {
      if (one.use_count() == 1) return one;
    }
    return samples_.emplace_back(std::make_shared<Sample>());
  }
  /// Takes over memory of a spectrum that is not sampled any more.
  virtual void reuse(Spectrum& other) { samples_.swap(other.samples_); }

  /// y^H A x of a root's vectors, for models whose parts A are known here.
  virtual std::optional<Forms> forms(const Pair&) const { return {}; }

  /// Steps in u above this are halved before anything is sampled, for a pipe without weight.
  /// Measured on 52 undamped pipes of 20 functions up to u = 20: 72 eigenproblems and refinements
  /// per sweep; 98 with steps of 0.5, and 64 and 62 with steps of 1.5 and 2, which are ambiguous
  /// and halved anyway. Near -1 / delta, where roots of many modes meet, shorter steps are needed
  /// to tell the roots apart. If the fastest root followed is far enough from there, no root comes
  /// near, and the steps are the longer ones.
  double longest_step(const Values& at_rest) const {
    const Index last = at_rest.size() - 1;
    return last >= 0 && traits.delta * magnitude(at_rest[last]) > 0.5 ? 0.5 : 1.0;
  }

  /// Number of roots that are exactly zero at every speed.
  virtual Index standing() { return 0; }

  /// The root next to a guess. The value of the guess is used and, if known, its right vector.
  /// vectors: whether the vectors of the root are needed.
  virtual Pair refined(double u, const Pair& guess, bool vectors = true) = 0;

  /// Rayleigh quotients x^H K x / x^H M x of roots' vectors at a speed. At rest a quotient is the
  /// square of the frequency that a mode would have without damping, and the same for both roots of
  /// a mode whose shape damping does not change. Those of undamped roots are -lambda^2 and need no
  /// vectors.
  virtual Reals quotients(double u, const Pairs& pairs) = 0;

  /// Every speed in (0, max_speed] at which K is singular, from K alone and all at once: no root is
  /// followed. first: whether speeds beyond the lowest two may be left out. Throws NotConverged
  /// where rounding hides whether K is singular.
  virtual Divergences divergences(double max_speed, bool first) = 0;

  /// The problem whose real roots are those of the pipe. A loss factor acts only on oscillation, so
  /// the real roots of a pipe with one are those of the pipe without it.
  virtual Spectrum& without_loss() { return without_loss_ == nullptr ? *this : *without_loss_; }
  void set_without_loss(std::shared_ptr<Spectrum> other) { without_loss_ = std::move(other); }

  /// The numbers on which all roots depend continuously, in an order that is the same for all
  /// models of one kind and size; none where they are not known.
  virtual std::vector<double> numbers() const { return {}; }

  /// Corrects starts for all roots at a speed, of each conjugate pair the upper one; returns
  /// whether they lead to all of them.
  virtual bool all_roots(double, Values&) { return false; }

  /// Number of matrices factorised since the last call; an eigenvalue problem counts as one.
  int factorisations() {
    const int others = without_loss_ == nullptr ? 0 : without_loss_->factorisations();
    return std::exchange(factorised_, 0) + others;
  }

  const Traits traits;

 protected:
  int factorised_ = 0;

 private:
  std::shared_ptr<Spectrum> without_loss_;
  std::vector<std::shared_ptr<Sample>> samples_;  // as many as were in use at a time
};

}  // namespace pipedyn
