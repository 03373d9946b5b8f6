// SPDX-License-Identifier: MIT
#include "pipedyn/chain/chain.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/chain/stations.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Distance up to which two places on the pipe count as the same place: rounding of the lengths
/// must not decide at which segment's end a place lies.
constexpr double at_joint = 1e-12;

void require_rows(Index rows, Index dof) {
  if (rows != dof) {
    throw std::invalid_argument("expected one row a segment, " + std::to_string(dof) + ", got " +
                                std::to_string(rows));
  }
}

/// Calls body(law, term, segment, arm, weight) for each place where a term acts, with segments
/// counted from 0. The weight is 1, or the length that a Gauss point represents: a law per length
/// acts at two Gauss points of each segment, which is exact if it is linear in position and
/// velocity. A term at a place of the fixed base moves nothing and is left out; a term where two
/// segments meet acts on the segment that ends there. base: length of the fixed base.
template <class Body>
void for_each_place(const Terms& terms, const Vector& length, double base, const Body& body) {
  const Index n = length.size();
  for (const Term& term : terms) {
    Laws::with(term, [&](const auto& law) {
      if (law.along) {
        const double gauss = 0.5 / std::sqrt(3.0);
        for (Index j = 0; j < n; ++j) {
          for (const double point : {0.5 - gauss, 0.5 + gauss}) {
            body(law, term, j, point * length[j], 0.5 * length[j]);
          }
        }
        return;
      }
      if (term.at <= base) return;
      Index j = 0;
      double start = base;
      while (j + 1 < n && term.at > start + length[j] + at_joint) start += length[j++];
      body(law, term, j, std::min(term.at - start, length[j]), 1.0);
    });
  }
}

/// Sums of each segment's loads, LoadMoments, for the chain at rest at the angles.
std::vector<LoadMoments<double>> loads_at(const MotionModel& model, const Vector& angles,
                                          const Vector& sine, const Vector& cosine) {
  std::vector<LoadMoments<double>> sums(static_cast<std::size_t>(model.size));
  load_moments(
      model, sine.data(), cosine.data(), [&](Index j) { return angles[j]; },
      [](Index) { return 0.0; }, Driven<double>{}, sums.data());
  return sums;
}

}  // namespace

Chain::Chain(const Pipe& pipe, Segments segments) : pipe_(pipe), segments_(std::move(segments)) {
  auto& [l, chi, eta, spring, xi, base, damping, rest_moment, mass] = segments_;
  const Index n = dof();
  const Index joints = n + (pipe_.is_guided() ? 1 : 0);
  damped_springs_ = spring;
  if (damping.size() == 0) damping = pipe_.damping * spring;
  if (rest_moment.size() == 0) rest_moment = Vector::Zero(n);
  if (mass.size() == 0) mass = l;
  if (n < 1 || chi.size() != n || eta.size() != n || xi.size() != n || rest_moment.size() != n ||
      mass.size() != n || spring.size() != joints || damping.size() != joints) {
    throw std::invalid_argument("segments must have one entry a segment in every array" +
                                std::string(joints > n ? ", and one more joint" : ""));
  }
  if (pipe_.is_guided()) {
    end_spring_ = spring[n];
    end_damping_ = damping[n];
    for (Vector* const of : {&spring, &damping, &damped_springs_}) of->conservativeResize(n);
  }
  held_.resize(static_cast<std::size_t>(n));
  if (std::isfinite(pipe_.root)) {
    const double share = pipe_.root > 0.0 ? pipe_.root / (pipe_.root + spring[0]) : 0.0;
    spring[0] *= share;  // spring of both in series
    rest_moment[0] *= share;
    damping[0] *= share * share;
    damped_springs_[0] *= share * share;
  }
  if (const double rotary = pipe_.rotary_inertia; rotary > 0.0) {
    eta = (eta.array().square() + rotary * l.array() / mass.array()).sqrt();
  }
  Vector masses = mass, across_alone = Vector::Zero(n);
  const auto add_mass = [&](Index j, double arm, double added) {
    const double own = masses[j], total = own + added, share = added / total;
    const double apart = arm - chi[j] * l[j];
    eta[j] = std::sqrt(own / total * (eta[j] * eta[j] + share * apart * apart));
    chi[j] += share * apart / l[j];
    masses[j] = total;
  };
  const auto add_inertia = [&](Index j, double added) {
    if (masses[j] == 0.0) {
      throw std::invalid_argument("a segment without mass has no rotary inertia");
    }
    eta[j] = std::sqrt(eta[j] * eta[j] + added / masses[j]);
  };
  for_each_place(
      pipe_.terms, l, base,
      [&]<class Law>(const Law& law, const Term& term, Index j, double arm, double weight) {
        if (law.mass() != 0.0) add_mass(j, arm, weight * law.mass());
        if (law.inertia() != 0.0) add_inertia(j, law.inertia());
        across_alone[j] += weight * law.normal_mass();
        if (has_load<Law>) loads_.push_back({j, arm, weight, term});
      });
  std::stable_sort(
      loads_.begin(), loads_.end(),
      [](const SegmentTerm& one, const SegmentTerm& other) { return one.segment < other.segment; });
  damped_ = (damping.array() != 0.0).any() || end_damping_ != 0.0;
  bent_ = (rest_moment.array() != 0.0).any();
  links_.resize(static_cast<std::size_t>(n));
  first_moment_.resize(n);
  double beyond = 0.0;
  for (Index j = n - 1; j >= 0; --j) {
    const double own = masses[j], arm = chi[j] * l[j], rest = l[j] - arm, square = eta[j] * eta[j];
    const double inertia = own * (arm * arm + square);
    // Mass with inertia only across the segment is spread evenly along it; in that direction it and
    // the segment's own mass form one body.
    const double more = across_alone[j], apart = arm - 0.5 * l[j], twelfth = l[j] * l[j] / 12.0;
    const double about_centres = own * (square + apart * apart) + (own + more) * twelfth;
    first_moment_[j] = l[j] * (beyond + own * chi[j]);
    links_[static_cast<std::size_t>(j)] = {
        .length = l[j],
        .length_square = l[j] * l[j],
        .mass = own,
        .added = more,
        .first_moment = own * arm + 0.5 * l[j] * more,
        .inertia = inertia + 4.0 * twelfth * more,
        .end_inertia = own * (rest * rest + square) + 4.0 * twelfth * more,
        .own_inertia = own * own * eta[j] * eta[j] + more * about_centres,
        .exchange = own * (square - arm * rest) - 2.0 * twelfth * more,
        .spring = spring[j],
        .damping = damping[j],
        .rest_moment = rest_moment[j],
        .drag_arm = xi[j] * l[j],
        .drag = pipe_.drag * l[j],
        .weight = pipe_.gamma * first_moment_[j]};
    beyond += own;
  }
  linearise();
}

void Chain::linearise() {
  const Index n = dof();
  std::vector<LoadMoments<double>> sums;
  if (!loads_.empty()) sums = loads_at(motion(), Vector::Zero(n), Vector::Zero(n), Vector::Ones(n));
  double tension = 0.0;  // sum of the loads along the pipe beyond the segment
  impedances_.resize(static_cast<std::size_t>(n));
  for (Index j = n - 1; j >= 0; --j) {
    const Link& link = this->link(j);
    ImpedanceSegment& made = impedances_[static_cast<std::size_t>(j)];
    made = {.length = link.length,
            .joint = {link.spring, link.damping, 0.0},
            .force = {0.0, 0.0, link.mass + link.added},
            .across = {0.0, 0.0, link.first_moment},
            .turned = {0.0, 0.0, link.first_moment},
            .moment = {link.weight, 0.0, link.inertia},
            .joint_loss = pipe_.hysteresis * damped_springs_[j],
            .moment_loss = 0.0,
            .turned_size = 0.0,
            .moment_size = std::abs(link.weight),
            .held = held_[static_cast<std::size_t>(j)],
            .loaded = false,
            .repeats = false};
    if (j == n - 1) {
      made.moment.still += end_spring_;
      made.moment.rate += end_damping_;
      made.moment_loss = pipe_.hysteresis * end_spring_;
      made.moment_size += end_spring_ + made.moment_loss;
      made.loaded = end_damping_ != 0.0 || made.moment_loss != 0.0;
    }
    if (sums.empty()) continue;
    const auto& [load, slopes, any] = sums[static_cast<std::size_t>(j)];
    const double pulled = link.length * tension + load[1][1];
    tension += load[0][1];
    // Derivatives of the transverse force and the moment by displacement and angle, or by their
    // rates.
    const auto add_slopes = [&, &of = slopes](int place, int angle, double ImpedanceParts::* to) {
      const double force[2] = {-of[1].by[0][place], -of[0].by[0][angle]};
      const double moment[3] = {-of[2].by[0][place], -of[1].by[0][angle] - of[1].by[2][place],
                                -of[0].by[2][angle]};
      made.force.*to -= of[0].by[0][place];
      made.across.*to -= of[1].by[0][place] + of[0].by[2][place];
      made.turned.*to += force[0] + force[1];
      made.moment.*to += moment[0] + moment[1] + moment[2];
      return std::array{std::abs(force[0]) + std::abs(force[1]),
                        std::abs(moment[0]) + std::abs(moment[1]) + std::abs(moment[2])};
    };
    const auto [turned_size, moment_size] =
        add_slopes(by_position, by_angle, &ImpedanceParts::still);
    add_slopes(by_velocity, by_rate, &ImpedanceParts::rate);
    made.turned_size = turned_size;
    made.moment_size += moment_size + std::abs(pulled);
    made.moment.still += pulled;
    made.loaded = made.loaded || made.moment.rate != 0.0;
    for (const ImpedanceParts* const part : {&made.force, &made.across, &made.turned}) {
      made.loaded = made.loaded || part->rate != 0.0 || part->still != 0.0;
    }
  }
  for (std::size_t j = 1; j < impedances_.size(); ++j) {
    impedances_[j - 1].repeats = impedances_[j - 1] == impedances_[j];
  }
}

ImpedanceModel Chain::impedance() const {
  return {.segments = impedances_.data(),
          .size = dof(),
          .coriolis = pipe_.direction() * pipe_.sqrt_beta(),
          .entry = pipe_.entry(),
          .thrust = pipe_.thrust()[0],
          .guided = pipe_.is_guided()};
}

Matrix Chain::held_rows(const Vector& scale) const {
  const Index n = dof();
  require_rows(scale.size(), n);
  std::vector<Index> ends;
  for (Index j = 0; j < n; ++j) {
    if (held_[static_cast<std::size_t>(j)]) ends.push_back(j);
  }
  Matrix rows = Matrix::Zero(n, static_cast<Index>(ends.size()));
  for (Index k = 0; k < rows.cols(); ++k) {
    double apart = 0.0;
    for (Index j = ends[static_cast<std::size_t>(k)]; j >= 0; --j) {
      apart += segments_.length[j];
      rows(j, k) = apart * scale[j];
    }
  }
  return rows;
}

Chain Chain::coarser(Index segments) const {
  // Groups end where the sum of relative length and relative compliance has grown by equal parts.
  const auto& [l, chi, eta, spring, xi, base, own_damping, rest_moment, own_mass] = segments_;
  const Index n = dof();
  const Vector soft = spring.cwiseMax(1e-6 * spring.mean() + 1e-300).cwiseInverse();
  const Vector measure = l / l.sum() + soft / soft.sum();
  std::vector<Index> ends;  // one past the last segment of each group
  std::vector<bool> held_ends;
  double grown = 0.0;
  Index parts = 1;
  for (Index j = 0; j < n; ++j) {
    grown += measure[j];
    const bool is_held = held_[static_cast<std::size_t>(j)];
    const double next = j + 1 < n ? 0.5 * measure[j + 1] : 0.0;
    const bool due =
        grown + next >= 2.0 * static_cast<double>(parts) / static_cast<double>(segments);
    if (j + 1 < n && !due && !is_held) continue;
    parts += due;
    ends.push_back(j + 1);
    held_ends.push_back(is_held);
  }
  const Index groups = static_cast<Index>(ends.size());
  Segments joined{.length = Vector::Zero(groups),
                  .center = Vector::Zero(groups),
                  .gyration_radius = Vector::Zero(groups),
                  .spring = Vector::Zero(groups),
                  .drag_point = Vector::Constant(groups, 0.5),
                  .base = base};
  joined.mass = Vector::Zero(groups);
  // Coefficients of 1 / (k + c lambda) = compliance - loss lambda of each joint of the coarser
  // chain, the joint of a guided end among them.
  const bool guided = pipe_.is_guided();
  Vector compliance = Vector::Zero(groups + (guided ? 1 : 0)), loss = compliance;
  const auto add_joint = [&](Index to, double softness, double own) {
    compliance[to] += softness;
    loss[to] += own * softness * softness;
  };
  if (guided) add_joint(groups, 1.0 / std::max(end_spring_, 1.0 / soft.maxCoeff()), end_damping_);
  for (Index group = 0, j = 0; group < groups; ++group) {
    const Index start = j, end = ends[static_cast<std::size_t>(group)];
    // Moments of the group's mass, of orders 0, 1 and 2, about its joint.
    double mass = 0.0, first = 0.0, second = 0.0;
    double at = 0.0;
    const double length = l.segment(start, end - start).sum();
    for (; j < end; at += l[j], ++j) {
      const double middle = at + chi[j] * l[j], own = own_mass[j];
      mass += own;
      first += own * middle;
      second += own * (middle * middle + eta[j] * eta[j]);
      // A joint beyond the middle of its group counts towards the next group's joint; in the last
      // group there may be no next joint.
      const Index nearest = at <= 0.5 * length ? group : group + 1;
      if (nearest < compliance.size()) add_joint(nearest, soft[j], own_damping[j]);
    }
    const double centre = first / mass;
    joined.length[group] = length;
    joined.mass[group] = mass;
    joined.center[group] = centre / length;
    joined.gyration_radius[group] = std::sqrt(std::max(second / mass - centre * centre, 0.0));
  }
  joined.spring = compliance.cwiseInverse();
  joined.damping = loss.cwiseProduct(joined.spring.cwiseAbs2());
  Pipe clamped = pipe_;  // the first joint's spring includes the root's
  clamped.root = std::numeric_limits<double>::infinity();
  clamped.rotary_inertia = 0.0;  // the radii of gyration include it
  return Chain(clamped, std::move(joined)).guided(std::move(held_ends));
}

Operators Chain::operators(const Vector& angles) const {
  const Index n = dof();
  Vector sine = Vector::Zero(n), cosine = Vector::Ones(n);
  if (angles.size() > 0) require_rows(angles.size(), n);
  for (Index k = 0; k < angles.size(); ++k) {
    sine[k] = std::sin(angles[k]);
    cosine[k] = std::cos(angles[k]);
  }
  const auto cosine_between = [&](Index k, Index i) {
    return cosine[k] * cosine[i] + sine[k] * sine[i];
  };
  const double sqrt_beta = pipe_.sqrt_beta(), share = pipe_.inflow_share;
  const bool guided = pipe_.is_guided();
  const double end = guided || angles.size() == 0 ? 0.0 : angles[n - 1];
  const double jet = end + pipe_.jet_angle;
  double beyond = 0.0, spring_beyond = end_spring_, damping_beyond = end_damping_;
  Operators ops(n);
  for (Index k = n - 1; k >= 0; --k) {
    const Link& link = this->link(k);
    const double l = link.length;
    ops.mass(k, k) = link.length_square * beyond + link.inertia;
    ops.end_flux(k, k) = share * sqrt_beta * l * l;
    for (Index i = k + 1; i < n; ++i) {
      const double turned = cosine_between(k, i);
      const double product = sqrt_beta * l * this->link(i).length * turned;
      ops.mass(k, i) = ops.mass(i, k) = l * first_moment_[i] * turned;
      ops.end_flux(k, i) = ops.end_flux(i, k) = share * product;
      ops.gyroscopic(k, i) = ops.unsteady(k, i) = product;
      ops.gyroscopic(i, k) = -product;
      ops.unsteady(k, k) -= product;
    }
    const double thrust = l * (cosine[k] * std::cos(jet) + sine[k] * std::sin(jet));
    ops.flux(k, k) -= thrust;
    if (!guided) ops.flux(k, n - 1) += thrust;
    const double elastic = link.spring + spring_beyond;
    ops.stiffness(k, k) = elastic + pipe_.gamma * (first_moment_[k] * cosine[k]);
    ops.damping(k, k) = link.damping + damping_beyond;
    if (k + 1 < n) {
      ops.stiffness(k, k + 1) = ops.stiffness(k + 1, k) = -spring_beyond;
      ops.damping(k, k + 1) = ops.damping(k + 1, k) = -damping_beyond;
    }
    beyond += link.mass;
    spring_beyond = link.spring;
    damping_beyond = link.damping;
  }
  if (!loads_.empty()) {
    add_loads(angles.size() > 0 ? angles : Vector(Vector::Zero(n)), sine, cosine, ops);
    add_normal_mass(sine, cosine, ops.mass);
  }
  return ops;
}

void Chain::add_normal_mass(const Vector& sine, const Vector& cosine, Matrix& mass) const {
  double beyond[2][2] = {};  // sum of m n n^T of the segments beyond
  for (Index i = dof() - 1; i >= 0; --i) {
    const Link& link = this->link(i);
    const Plane<double> across{cosine[i], -sine[i]}, own = scaled(link.added, across);
    // Momentum of the masses on segment i and beyond, by the rate of segment i.
    const Plane<double> moved = plus(scaled(link.length, times(beyond, across)),  // beyond
                                     scaled(0.5 * link.length, own));             // segment i
    for (Index k = 0; k < i; ++k) {
      const double both = this->link(k).length * dot({cosine[k], -sine[k]}, moved);
      mass(k, i) += both;
      mass(i, k) += both;
    }
    mass(i, i) += link.length_square * dot(across, times(beyond, across));
    beyond[0][0] += own.x * across.x;
    beyond[0][1] += own.x * across.y;
    beyond[1][0] += own.y * across.x;
    beyond[1][1] += own.y * across.y;
  }
}

void Chain::add_loads(const Vector& angles, const Vector& sine, const Vector& cosine,
                      Operators& ops) const {
  const std::vector<LoadMoments<double>> sums = loads_at(motion(), angles, sine, cosine);
  const auto normal = [&](Index k) { return Plane<double>{cosine[k], -sine[k]}; };
  Slopes<double> beyond;  // derivatives of all loads beyond segment i
  Plane<double> load{0.0, 0.0};
  for (Index i = dof() - 1; i >= 0; --i) {
    const auto& [loads, slopes, any] = sums[static_cast<std::size_t>(i)];
    const double l = link(i).length;
    const Plane<double> across = normal(i), along{sine[i], cosine[i]};
    // Sums with arm and arm^2 about the joint of segment i, the loads beyond it included.
    Slopes<double> arm = slopes[1], own = slopes[2];
    add(arm, l, beyond);
    add(own, l * l, beyond);
    const auto add_slopes = [&, &of = slopes](Variable place, Variable angle, Matrix& to) {
      const Plane<double> moved = plus(force_by(arm, place, across), force_by(of[0], angle));
      const Plane<double> turned = plus(work_by(arm, place, across), couple_by(of[0], place));
      for (Index k = 0; k < i; ++k) {
        const Plane<double> other = scaled(link(k).length, normal(k));
        to(k, i) -= dot(other, moved);
        to(i, k) -= dot(turned, other);
      }
      to(i, i) -= dot(across, plus(force_by(own, place, across), force_by(of[1], angle)));
      to(i, i) -= dot(across, couple_by(of[1], place)) + of[0].by[2][angle];
    };
    add_slopes(by_position, by_angle, ops.stiffness);
    add_slopes(by_velocity, by_rate, ops.damping);
    ops.stiffness(i, i) += dot(along, plus(scaled(l, load), plane(loads[1])));
    add(beyond, 1.0, slopes[0]);
    load = plus(load, plane(loads[0]));
  }
}

Operators Chain::joint_operators(const Vector& scale) const {
  require_rows(scale.size(), dof());
  const Matrix columns = scale.asDiagonal();
  const auto part = [&](const LinearPart& of) -> Matrix {
    return scale.asDiagonal() * joint_times(columns, of);
  };
  Operators ops(dof());
  ops.mass = part({.mass = 1.0});
  ops.damping = part({.damping = 1.0});
  ops.stiffness = part({.stiffness = 1.0});
  ops.flux = part({.flux = 1.0});
  ops.unsteady = pipe_.direction() * part({.unsteady = 1.0});
  const Matrix velocity = pipe_.direction() * part({.velocity = 1.0});
  ops.gyroscopic = 0.5 * (velocity - velocity.transpose());
  ops.end_flux = velocity - ops.gyroscopic;
  return ops;
}

Matrix Chain::joint_times(const Matrix& x, const LinearPart& part) const {
  const Index n = dof(), columns = x.cols();
  require_rows(x.rows(), n);
  const double flow = pipe_.sqrt_beta() * pipe_.direction();
  const double coriolis = part.velocity * flow, push = part.unsteady * flow;
  const double thrust = part.flux * std::cos(pipe_.jet_angle);
  const auto sum = [&](const ImpedanceParts& of) {
    return part.stiffness * of.still + part.damping * of.rate + part.mass * of.square;
  };
  using Row = Eigen::RowVectorXd;
  Matrix out(n, columns), force(n, columns);
  Row angle = Row::Zero(columns), place = angle, moment = angle;
  double left = segments_.length.sum();  // length of the pipe beyond a segment
  for (Index j = 0; j < n; ++j) {
    const ImpedanceSegment& at = impedances_[static_cast<std::size_t>(j)];
    const double l = at.length;
    angle += x.row(j);
    left -= l;
    const double turned = 2.0 * l * coriolis + l * push;
    force.row(j) = sum(at.force) * place + (sum(at.turned) + turned) * angle;
    const double own =
        l * l * coriolis - l * (thrust + left * push) + part.gravity * first_moment_[j];
    out.row(j) = sum(at.across) * place + (sum(at.moment) + own) * angle;
    place += l * angle;
  }
  out.row(n - 1) += (part.by_damping * end_spring_) * angle;
  Row beyond = -part.velocity * pipe_.entry() * place;
  if (!pipe_.is_guided()) beyond += thrust * angle;
  for (Index j = n - 1; j >= 0; --j) {
    const ImpedanceSegment& at = impedances_[static_cast<std::size_t>(j)];
    moment += out.row(j) + at.length * beyond;
    beyond += force.row(j);
    out.row(j) = moment + (sum(at.joint) + part.by_damping * damped_springs_[j]) * x.row(j);
  }
  return out;
}

Chain Chain::without_forces() const {
  Chain made = *this;
  made.pipe_ = Pipe{.centrifugal = 0.0};
  made.loads_.clear();
  made.damped_ = made.bent_ = false;
  made.end_spring_ = made.end_damping_ = 0.0;
  for (Vector* const of :
       {&made.segments_.spring, &made.segments_.damping, &made.segments_.rest_moment}) {
    of->setZero();
  }
  for (Link& link : made.links_) {
    link.spring = link.damping = link.rest_moment = link.drag = link.weight = 0.0;
  }
  made.linearise();
  return made;
}

Chain Chain::guided(std::vector<bool> held) const {
  require_rows(static_cast<Index>(held.size()), dof());
  Chain made = *this;
  made.held_ = std::move(held);
  made.linearise();
  return made;
}

Matrix Chain::bodies() const {
  Matrix out(dof(), 4);
  for (Index j = 0; j < dof(); ++j) {
    out(j, 0) = link(j).mass;
    out(j, 3) = link(j).added;
  }
  out.col(1) = segments_.center;
  out.col(2) = segments_.gyration_radius;
  return out;
}

Matrix Chain::joints() const {
  const Index n = dof();
  Matrix out = Matrix::Zero(n + (pipe_.is_guided() ? 1 : 0), 3);
  out.topRows(n) << segments_.spring, segments_.damping, segments_.rest_moment;
  if (out.rows() > n) out.row(n) << end_spring_, end_damping_, 0.0;
  return out;
}

Matrix Chain::places() const {
  Matrix out(static_cast<Index>(loads_.size()), 3);
  for (Index i = 0; i < out.rows(); ++i) {
    const SegmentTerm& place = loads_[static_cast<std::size_t>(i)];
    out.row(i) << static_cast<double>(place.segment), place.arm, place.weight;
  }
  return out;
}

Matrix Chain::loads(const Matrix& stations) const {
  if (stations.rows() != static_cast<Index>(loads_.size()) || stations.cols() != 8) {
    throw std::invalid_argument("stations must have one row of 8 numbers a place");
  }
  Matrix out(stations.rows(), 3);
  for (Index i = 0; i < out.rows(); ++i) {
    const auto row = stations.row(i);
    const Station<double> at{row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]};
    Laws::with(loads_[static_cast<std::size_t>(i)].term, [&](const auto& law) {
      const Acting<double> load(law.load(at));
      out.row(i) << load.x, load.y, load.couple;
    });
  }
  return out;
}

MotionModel Chain::motion() const {
  return {.links = links_.data(),
          .size = dof(),
          .base = segments_.base,
          .gravity = pipe_.gamma,
          .coriolis = pipe_.direction() * pipe_.sqrt_beta(),
          .entry = pipe_.entry(),
          .thrust = pipe_.thrust(),
          .damped = damped_,
          .bent = bent_,
          .guided = pipe_.is_guided(),
          .end_spring = end_spring_,
          .end_damping = end_damping_,
          .drag = pipe_.drag != 0.0,
          .loads = loads_.data(),
          .load_count = static_cast<std::ptrdiff_t>(loads_.size())};
}

void Chain::rhs(const Batch& batch, double* rates) const {
  motion_kernel().rhs(motion(), batch, rates);
}

void Chain::rhs_and_power(const Batch& batch, double* rates) const {
  motion_kernel().rhs_and_power(motion(), batch, rates);
}

void Chain::axial(const Batch& batch, double* out) const {
  motion_kernel().axial(motion(), batch, out);
}

void Chain::jacobian(const Batch& batch, double* out) const {
  motion_kernel().jacobian(motion(), batch, out);
}

Index Chain::factor_numbers() const { return motion_kernel().factor_numbers(motion()); }

void Chain::factorise(const Batch& one, const double* mu, double* factors) const {
  motion_kernel().factorise(motion(), one, mu, factors);
}

void Chain::solve(double u, double* factors, double* b) const {
  motion_kernel().solve(motion(), u, factors, b);
}

void Chain::energy(const Batch& batch, double* out) const {
  motion_kernel().energy(motion(), batch, out);
}

void Chain::power(const Batch& batch, double* out) const {
  motion_kernel().power(motion(), batch, out);
}

}  // namespace pipedyn
