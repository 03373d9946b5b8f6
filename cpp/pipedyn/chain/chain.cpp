// SPDX-License-Identifier: MIT
#include "pipedyn/chain/chain.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/chain/spatial_chain.hpp"
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
/// segments meet acts on the segment that ends there. base: length of the fixed base. The term has
/// the arc length of its place, also if it acts all along.
template <class Body>
void for_each_place(const Terms& terms, const Vector& length, double base, const Body& body) {
  const Index n = length.size();
  for (const Term& term : terms) {
    Laws::with(term, [&](const auto& law) {
      if (law.along) {
        const double gauss = 0.5 / std::sqrt(3.0);
        Term placed = term;
        double before = base;
        for (Index j = 0; j < n; ++j) {
          for (const double point : {0.5 - gauss, 0.5 + gauss}) {
            placed.at = before + point * length[j];
            body(law, placed, j, point * length[j], 0.5 * length[j]);
          }
          before += length[j];
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

/// Sums of each segment's loads for the chain at rest at the angles (n); empty if it has no loads.
std::vector<LoadMoments<double>> loads_at(const ChainModel& model, const Vector& angles) {
  if (model.load_count == 0) return {};
  std::vector<LoadMoments<double>> sums(static_cast<std::size_t>(model.size));
  const Vector sine = angles.array().sin(), cosine = angles.array().cos();
  load_moments(
      model, sine.data(), cosine.data(), [&](Index j) { return angles[j]; },
      [](Index) { return 0.0; }, Driven<double>{}, sums.data());
  return sums;
}

/// Derivatives of the force on a segment, and of its moment about the joint, by the displacement of
/// the joint and by the angle, for a sum of the parts of the linear problem.
struct SegmentSlopes {
  double force[2][2];    // force by displacement
  Plane<double> turned;  // force by angle
  Plane<double> moment;  // moment by displacement
  double turned_moment;  // moment by angle

  /// loads: sums of the segment's loads, or null; flow: sqrt(beta) s; n: normal of the segment.
  SegmentSlopes(const Link& link, const LoadMoments<double>* loads, const LinearPart& part,
                double flow, const Plane<double>& n) {
    const double mass = part.mass * link.mass, lever = part.mass * link.first_moment;
    const double coriolis = part.velocity * flow, push = part.unsteady * flow;
    const Plane<double> added = scaled(part.mass * link.added, n);
    force[0][0] = mass + added.x * n.x;
    force[0][1] = added.x * n.y;
    force[1][0] = added.y * n.x;
    force[1][1] = mass + added.y * n.y;
    turned = scaled(lever + link.length * (2.0 * coriolis + push), n);
    moment = scaled(lever, n);
    turned_moment = part.mass * link.inertia + link.length * link.length * coriolis;
    if (loads == nullptr) return;
    const Slopes<double>(&of)[3] = loads->slopes;
    const auto add = [&](double factor, Variable place, Variable angle) {
      for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2; ++k) force[i][k] += factor * of[0].by[i][place + k];
      }
      turned =
          plus(turned, scaled(factor, plus(force_by(of[1], place, n), force_by(of[0], angle))));
      moment =
          plus(moment, scaled(factor, plus(work_by(of[1], place, n), couple_by(of[0], place))));
      const Plane<double> lifted = plus(force_by(of[2], place, n), force_by(of[1], angle));
      turned_moment +=
          factor * (dot(n, plus(lifted, couple_by(of[1], place))) + of[0].by[2][angle]);
    };
    if (part.stiffness != 0.0) add(-part.stiffness, by_position, by_angle);
    if (part.damping != 0.0) add(-part.damping, by_velocity, by_rate);
  }
};

}  // namespace

Chain::Chain(const Pipe& pipe, Segments segments) : pipe_(pipe), segments_(std::move(segments)) {
  auto& [l, chi, eta, spring, xi, base, damping, rest_moment, mass] = segments_;
  const Index n = dof();
  const Index joints = n + (pipe_.end_guided() ? 1 : 0);
  damped_springs_ = spring;
  if (damping.size() == 0) damping = pipe_.damping * spring;
  if (rest_moment.size() == 0) rest_moment = Vector::Zero(n);
  if (mass.size() == 0) mass = l;
  if (n < 1 || chi.size() != n || eta.size() != n || xi.size() != n || rest_moment.size() != n ||
      mass.size() != n || spring.size() != joints || damping.size() != joints) {
    throw std::invalid_argument("segments must have one entry a segment in every array" +
                                std::string(joints > n ? ", and one more joint" : ""));
  }
  if (pipe_.end_guided()) {
    end_spring_ = spring[n];
    end_damping_ = damping[n];
    for (Vector* const of : {&spring, &damping, &damped_springs_}) of->conservativeResize(n);
  }
  held_.resize(static_cast<std::size_t>(n));
  if (std::isfinite(pipe_.root)) {
    const auto share_of = [&](double k) { return k > 0.0 ? k / (k + spring[0]) : 0.0; };
    const double share = share_of(pipe_.root);
    if (pipe_.root_across != 0.0) {
      const double across = share_of(pipe_.root + pipe_.root_across), at = 0.5 * l[0];
      const double stiffer = spring[0] * (across - share);
      const double damped = damping[0] * (across * across - share * share);
      pipe_.terms.push_back(make_term("rotational_spring", at, {0.0, stiffer}));
      pipe_.terms.push_back(make_term("rotational_damper", at, {0.0, damped}));
    }
    spring[0] *= share;  // spring of both in series
    rest_moment[0] *= share;
    damping[0] *= share * share;
    damped_springs_[0] *= share * share;
  }
  if (const double rotary = pipe_.rotary_inertia; rotary > 0.0) {
    eta = (eta.array().square() + rotary * l.array() / mass.array()).sqrt();
  }
  Vector masses = mass, across_alone = Vector::Zero(n);
  Vector weightless = across_alone, weightless_moment = across_alone;  // parts of the masses
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
        weightless[j] += law.weightless();
        weightless_moment[j] += law.weightless() * arm;
        if (has_load<Law>) loads_.push_back({j, arm, weight, term});
      });
  std::stable_sort(
      loads_.begin(), loads_.end(),
      [](const SegmentTerm& one, const SegmentTerm& other) { return one.segment < other.segment; });
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
    first_moment_[j] = l[j] * (beyond + own * chi[j]) - weightless_moment[j];
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
    beyond += own - weightless[j];
  }
  linearise();
}

void Chain::linearise() {
  const Index n = dof();
  const std::vector<LoadMoments<double>> sums = loads_at(model(), Vector::Zero(n));
  const std::pair<LinearPart, double StiffnessParts::*> parts[] = {
      {{.stiffness = 1.0}, &StiffnessParts::stiffness},
      {{.damping = 1.0}, &StiffnessParts::damping},
      {{.mass = 1.0}, &StiffnessParts::mass}};
  double tension = 0.0;  // sum of the loads along the pipe beyond the segment
  dynamic_stiffnesses_.assign(static_cast<std::size_t>(n), {});
  for (Index j = n - 1; j >= 0; --j) {
    const Link& link = this->link(j);
    const auto* const loads = sums.empty() ? nullptr : &sums[static_cast<std::size_t>(j)];
    StiffnessSegment& made = dynamic_stiffnesses_[static_cast<std::size_t>(j)];
    made.length = link.length;
    made.joint = {link.spring, link.damping, 0.0};
    made.joint_hysteresis = pipe_.hysteresis * damped_springs_[j];
    made.held = held_[static_cast<std::size_t>(j)];
    for (const auto& [part, to] : parts) {
      const SegmentSlopes slopes(link, loads, part, 0.0, {1.0, 0.0});
      made.force.*to = slopes.force[0][0];
      made.across.*to = slopes.moment.x;
      made.turned.*to = slopes.turned.x;
      made.moment.*to = slopes.turned_moment;
    }
    const auto add_to_moment = [&made](double stiffness) {
      made.moment_size += std::abs(stiffness);
      made.moment.stiffness += stiffness;
    };
    made.moment_size = std::abs(made.moment.stiffness);
    add_to_moment(pipe_.down()[1] * link.weight);
    if (loads != nullptr) {
      add_to_moment(link.length * tension + loads->load[1][1]);
      tension += loads->load[0][1];
    }
    if (j == n - 1) {
      add_to_moment(end_spring_);
      made.moment.damping += end_damping_;
      made.moment_hysteresis = pipe_.hysteresis * end_spring_;
      made.moment_size += made.moment_hysteresis;
    }
    made.loaded = made.moment.damping != 0.0 || made.moment_hysteresis != 0.0;
    for (const StiffnessParts* const part : {&made.force, &made.across, &made.turned}) {
      made.loaded = made.loaded || part->damping != 0.0 || part->stiffness != 0.0;
    }
  }
  for (std::size_t j = 1; j < dynamic_stiffnesses_.size(); ++j) {
    dynamic_stiffnesses_[j - 1].repeats = dynamic_stiffnesses_[j - 1] == dynamic_stiffnesses_[j];
  }
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
  const bool guided = pipe_.end_guided();
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

Operators Chain::operators(const Vector& angles, bool joints) const {
  const Index n = dof();
  if (angles.size() > 0) require_rows(angles.size(), n);
  const Vector at = angles.size() > 0 ? angles : Vector(Vector::Zero(n));
  const auto part = [&](const LinearPart& of) -> Matrix {
    Matrix found = moments(Matrix::Identity(n, n), of, at);
    if (!joints) return found;
    const Vector joint = joint_factors(of);
    const auto beyond = joint.tail(n - 1);
    found.diagonal() += joint;
    found.diagonal().head(n - 1) += beyond;
    found.diagonal(1) -= beyond;
    found.diagonal(-1) -= beyond;
    return found;
  };
  Operators ops(n);
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
  const Index n = dof();
  require_rows(x.rows(), n);
  Matrix angles = x;
  for (Index j = 1; j < n; ++j) angles.row(j) += angles.row(j - 1);
  Matrix out = moments(angles, part, Vector::Zero(n));
  for (Index j = n - 2; j >= 0; --j) out.row(j) += out.row(j + 1);
  out += joint_factors(part).asDiagonal() * x;
  return out;
}

Vector Chain::joint_factors(const LinearPart& part) const {
  return part.stiffness * segments_.spring + part.damping * segments_.damping +
         part.by_damping * damped_springs_;
}

Matrix Chain::moments(const Matrix& x, const LinearPart& part, const Vector& angles) const {
  const Index n = dof(), columns = x.cols();
  const std::vector<LoadMoments<double>> sums = loads_at(model(), angles);
  const bool loaded = !sums.empty(), guided = pipe_.end_guided();
  const double flow = pipe_.sqrt_beta() * pipe_.direction();
  const double entry = part.velocity * pipe_.entry(), push = part.unsteady * flow;
  const auto along = [&](double angle) { return Plane<double>{std::sin(angle), std::cos(angle)}; };
  const auto across = [](const Plane<double>& t) { return Plane<double>{t.y, -t.x}; };
  Matrix out(n, columns), force_x(n, columns), force_y(n, columns);
  using Row = Eigen::RowVectorXd;
  Row place_x = Row::Zero(columns), place_y = place_x;  // displacement of the joint
  for (Index j = 0; j < n; ++j) {
    const Link& link = this->link(j);
    const auto* const loads = loaded ? &sums[static_cast<std::size_t>(j)] : nullptr;
    const Plane<double> n_j = across(along(angles[j]));
    const auto [force, turned, moment, own] = SegmentSlopes(link, loads, part, flow, n_j);
    force_x.row(j) = force[0][0] * place_x + force[0][1] * place_y + turned.x * x.row(j);
    force_y.row(j) = force[1][0] * place_x + force[1][1] * place_y + turned.y * x.row(j);
    out.row(j) = moment.x * place_x + moment.y * place_y + own * x.row(j);
    place_x += (link.length * n_j.x) * x.row(j);
    place_y += (link.length * n_j.y) * x.row(j);
  }
  const Plane<double> jet = along(pipe_.jet_angle + (guided ? 0.0 : angles[n - 1]));
  const Plane<double> turned_jet = scaled(guided ? 0.0 : part.flux, across(jet));
  const auto [down_x, down_y] = pipe_.down();
  Row beyond_x = turned_jet.x * x.row(n - 1) - entry * place_x;
  Row beyond_y = turned_jet.y * x.row(n - 1) - entry * place_y;
  Plane<double> load{0.0, 0.0}, apart{0.0, 0.0};  // loads and pipe beyond the segment's end
  for (Index j = n - 1; j >= 0; --j) {
    const Link& link = this->link(j);
    const double l = link.length;
    const Plane<double> t_j = along(angles[j]), n_j = across(t_j);
    double own = dot(t_j, {down_x, down_y}) *
                     (part.stiffness * link.weight + part.gravity * first_moment_[j]) -
                 l * (part.flux * dot(t_j, jet) + push * dot(t_j, apart));
    if (j == n - 1)
      own += (part.stiffness + part.by_damping) * end_spring_ + part.damping * end_damping_;
    if (loaded) {
      const auto& of = sums[static_cast<std::size_t>(j)].load;
      own += part.stiffness * dot(t_j, plus(scaled(l, load), plane(of[1])));
      load = plus(load, plane(of[0]));
    }
    out.row(j) += (l * n_j.x) * beyond_x + (l * n_j.y) * beyond_y + own * x.row(j);
    beyond_x += force_x.row(j);
    beyond_y += force_y.row(j);
    apart = plus(apart, scaled(l, t_j));
  }
  return out;
}

Chain Chain::without_forces() const {
  Chain made = *this;
  made.pipe_ = Pipe{.end_coefficient = 0.0};
  made.loads_.clear();
  made.bent_ = false;
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
  Matrix out = Matrix::Zero(n + (pipe_.end_guided() ? 1 : 0), 3);
  out.topRows(n) << segments_.spring, segments_.damping, segments_.rest_moment;
  if (out.rows() > n) out.row(n) << end_spring_, end_damping_, 0.0;
  return out;
}

Vector Chain::elastic_scale() const {
  const double mean = springs().mean();
  const double floor = mean > 1e-100 ? 1e-3 * mean : static_cast<double>(dof());  // it is squared
  return springs().cwiseMax(floor).cwiseSqrt().cwiseInverse();
}

ChainModel Chain::model() const {
  return {.links = links_.data(),
          .dynamic_stiffnesses = dynamic_stiffnesses_.data(),
          .size = dof(),
          .base = segments_.base,
          .gravity = pipe_.gamma,
          .down = pipe_.down(),
          .coriolis = pipe_.direction() * pipe_.sqrt_beta(),
          .entry = pipe_.entry(),
          .thrust = pipe_.thrust(),
          .bent = bent_,
          .guided = pipe_.end_guided(),
          .end_spring = end_spring_,
          .end_damping = end_damping_,
          .drag = pipe_.drag != 0.0,
          .loads = loads_.data(),
          .load_count = static_cast<std::ptrdiff_t>(loads_.size())};
}

Matrix ends(const StateRows& angles, const StateRows& rates, const Vector& lengths) {
  const Index n = lengths.size(), count = angles.rows();
  if (angles.cols() != n || rates.cols() != n || rates.rows() != count) {
    throw std::invalid_argument("angles and rates must have a column for each segment");
  }
  Matrix found = Matrix::Zero(4, count);
  Vector sine = Vector::Zero(n + 7), cosine(n + 7);  // room for whole packs
  for (Index k = 0; k < count; ++k) {
    const double *angle = angles.data() + k * angles.outerStride(),
                 *rate = rates.data() + k * rates.outerStride();
    for (Index j = 0; j < n; ++j) sine[j] = angle[j * angles.innerStride()];
    motion_kernel().sincos(sine.data(), n, sine.data(), cosine.data());
    double sums[4] = {};
    for (Index j = 0; j < n; ++j) {
      const double x = lengths[j] * sine[j], y = lengths[j] * cosine[j];
      const double turning = rate[j * rates.innerStride()];
      sums[0] += x;
      sums[1] += y;
      sums[2] += y * turning;
      sums[3] -= x * turning;
    }
    for (Index i = 0; i < 4; ++i) found(i, k) = sums[i];
  }
  return found;
}

SpatialChain::SpatialChain(const Pipe& pipe, const Segments& segments, std::vector<Index> held)
    : chain_(pipe, segments), held_(std::move(held)) {
  require_space(pipe);
  if (chain_.model().bent) {
    throw std::invalid_argument("joints that are bent at rest have no equations in space here");
  }
  const ChainModel model = chain_.model();
  changes_charts_.assign(static_cast<std::size_t>(model.size), true);
  for (const SegmentTerm* load = model.loads; load != model.loads + model.load_count; ++load) {
    Laws::with(load->term, [&](const auto& law) {
      if (law.reads_rotation) changes_charts_[static_cast<std::size_t>(load->segment)] = false;
    });
  }
}

}  // namespace pipedyn
