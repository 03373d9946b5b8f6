// SPDX-License-Identifier: MIT
//
// The recursion of dynamic_stiffness.hpp for one vector level. This source is compiled once for
// each level, with PIPEDYN_LEVEL and PIPEDYN_WIDTH set.
#include "pipedyn/chain/dynamic_stiffness.hpp"

#include "pipedyn/vector/lanes.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

using pipedyn::ChainModel;
using pipedyn::PairsAsked;
using pipedyn::Points;
using pipedyn::StiffnessParts;
using pipedyn::StiffnessSegment;

/// lambda and its products in the coefficients; their absolute values, or derivatives by lambda.
template <class Number>
struct Powers {
  Number one, square;  // lambda, lambda^2
  Number coriolis;     // sqrt(beta) U lambda
};

/// Coefficients of one segment, the flow's contributions included.
template <class Number>
struct Coefficients {
  Number elastic, force, across, turned, moment;  // e k, z, f, t, g
};

/// Coefficients of a segment, or their derivatives from those of the powers; or, from absolute
/// values of the powers, sums of the absolute values of the numbers whose sums are the
/// coefficients.
template <bool derivatives = false, class Number>
inline Coefficients<Number> coefficients(const StiffnessSegment& at, const Powers<Number>& by) {
  constexpr bool sizes = std::is_same_v<Number, Pack>;
  const auto fixed = [](double x) { return derivatives ? 0.0 : x; };
  const auto of = [](double x) { return sizes ? std::fabs(x) : x; };
  const double l = at.length;
  Coefficients<Number> sum{at.joint.damping * by.one + fixed(at.joint.stiffness),
                           at.force.mass * by.square, at.across.mass * by.square,
                           at.turned.mass * by.square + (2.0 * l) * by.coriolis,
                           at.moment.mass * by.square + (l * l) * by.coriolis +
                               fixed(sizes ? at.moment_size : at.moment.stiffness)};
  if (at.loaded) {
    sum.force = sum.force + (of(at.force.damping) * by.one + fixed(of(at.force.stiffness)));
    sum.across = sum.across + (of(at.across.damping) * by.one + fixed(of(at.across.stiffness)));
    sum.turned = sum.turned + (of(at.turned.damping) * by.one + fixed(of(at.turned.stiffness)));
    sum.moment = sum.moment + of(at.moment.damping) * by.one;
  }
  if constexpr (sizes) {
    sum.elastic += at.joint_hysteresis;
  } else if constexpr (!derivatives) {
    sum.elastic.im += at.joint_hysteresis;
    sum.moment.im += at.moment_hysteresis;
  }
  return sum;
}

/// Numbers of T at as many lambda as Lanes has lanes, one in each.
struct Problem {
  Powers<Lanes> powers;
  double flow, entry, thrust;  // sqrt(beta) U, (1 - c) sqrt(beta) U and a U^2

  Problem() = default;
  Problem(const ChainModel& model, const Lanes& lambda, double u)
      : powers{lambda, lambda * lambda, (model.coriolis * u) * lambda},
        flow(model.coriolis * u),
        entry(model.entry * u),
        thrust(model.thrust[0] * u * u) {}

  Powers<Pack> sizes() const {
    const Pack size = size_of(powers.one);
    return {size, size * size, std::fabs(flow) * size};
  }

  Powers<Lanes> by_lambda() const { return {Lanes{} + 1.0, 2.0 * powers.one, Lanes{} + flow}; }
};

/// Reaction of the segments beyond the end of a segment to its motion: A, B, C and D.
struct DynamicStiffness {
  Lanes a, b, c, d;
};

/// Dynamic stiffness at the end of the last segment.
inline DynamicStiffness end_stiffness(const ChainModel& model, const Problem& problem) {
  DynamicStiffness end;
  end.a = -problem.entry * problem.powers.one;
  if (model.guided) end.b.re -= problem.thrust;
  return end;
}

/// The numbers R, W, H and p that eliminate a segment, or their derivatives by lambda.
struct Step {
  Lanes r, w, h, p;

  Step(double l, const DynamicStiffness& beyond, const Coefficients<Lanes>& at) {
    const Lanes carried = l * beyond.a, g = carried + beyond.b;
    r = at.moment + beyond.d + l * (beyond.c + g);
    w = at.across + beyond.c + carried;
    h = g + at.turned;
    p = at.elastic + r;
  }
};

/// Dynamic stiffness before a segment whose end is held. It is linear in beyond, at and thrust, so
/// that it gives derivatives as well.
inline DynamicStiffness before_held(double l, const DynamicStiffness& beyond,
                                    const Coefficients<Lanes>& at, double thrust) {
  const double share = 1.0 / l;
  DynamicStiffness found;
  found.d = at.elastic;
  found.b = found.c = share * at.elastic;
  found.b.re -= thrust;
  found.a =
      share * (share * (at.elastic + beyond.d + at.moment) - at.across - at.turned) + at.force;
  found.a.re -= share * thrust;
  return found;
}

void log_derivative(const ChainModel& model, const Points& points, double* out) {
  for (Count first = 0; first < points.count; first += width) {
    const Lanes lambda = lanes_of(points, first);
    const Problem problem(model, lambda, points.u);
    DynamicStiffness at = end_stiffness(model, problem), by;  // by: derivative of `at` by lambda
    by.a.re = all<Pack>(-problem.entry);
    Lanes sum = -1.0 * poles(points, lambda);
    Coefficients<Lanes> own, change;
    for (Count j = model.size - 1; j >= 0; --j) {
      const StiffnessSegment& segment = model.dynamic_stiffnesses[j];
      if (!segment.repeats) {
        own = coefficients(segment, problem.powers);
        change = coefficients<true>(segment, problem.by_lambda());
      }
      if (segment.held) {  // the pivot of a held segment is constant
        by = before_held(segment.length, by, change, 0.0);
        at = before_held(segment.length, at, own, problem.thrust);
        continue;
      }
      // Numbers divided by p = e k + R: d(e k / p) = -d(R / p) = kept / p.
      const Step step(segment.length, at, own), moved(segment.length, by, change);
      const Lanes share = inverse(step.p), pushed = (step.h + problem.thrust) * share;
      const Lanes w = step.w * share, r = step.r * share, e = own.elastic * share;
      const Lanes turned = segment.joint.damping * r, carried = e * moved.r,
                  kept = turned - carried;
      sum += moved.p * share;
      by = {by.a + change.force - w * (moved.h - pushed * moved.p) - pushed * moved.w,
            moved.h * e + pushed * kept, e * moved.w + w * kept, r * turned + e * carried};
      at = {at.a + own.force - pushed * step.w, step.h * e - problem.thrust * r, own.elastic * w,
            own.elastic * r};
    }
    put(out, points, first, sum);
  }
}

/// Joint angle, angle, and displacements of the joint and of the end of a segment. Inlined: as a
/// function call it would make `pairs` slower by a third.
struct Motion {
  Lanes turn, angle, joint, end;

  /// Replaces the motion of a segment by that of the next one, without a difference of nearly equal
  /// numbers. share: 1 / p; by_joint: W of the step, or H + a U^2 for the left vector; by_end: p -
  /// l by_joint; loaded: angle by which loads turn the next segment.
  PIPEDYN_INLINE void move(double l, const Lanes& share, const Lanes& elastic, const Lanes& r,
                           const Lanes& by_joint, const Lanes& by_end, const Lanes& loaded) {
    joint = end;
    turn = loaded - (r * angle + by_joint * joint) * share;
    end = l * loaded + (by_end * joint + l * (elastic * angle)) * share;
    angle = loaded + (elastic * angle - by_joint * joint) * share;
  }
  /// Replaces the motion of a segment by that of the next one, whose end is held.
  void move_to_guide(double l) {
    joint = end;
    end = {};
    turn = (-1.0 / l) * joint - angle;
    angle = (-1.0 / l) * joint;
  }
};

/// Effect of the loads on all segments beyond: the force and the moment at the segment's end that
/// they add to its dynamic_stiffness, and the angle by which they turn the segment.
struct LoadBeyond {
  Lanes force, moment, turned;
};

/// The parts of Y^T (dT/dlambda) X, summed over the segments.
struct Rates {
  Lanes mass, flow, damping;  // their factors are 2 lambda, sqrt(beta) U and 1

  PIPEDYN_INLINE void add(const StiffnessSegment& at, const Motion& dual, const Motion& motion) {
    const double l = at.length;
    const Lanes &x = motion.joint, &angle = motion.angle, &y = dual.joint, &other = dual.angle;
    mass += y * (at.force.mass * x + at.turned.mass * angle) +
            other * (at.across.mass * x + at.moment.mass * angle);
    flow += (l * other + 2.0 * y) * (l * angle);
    if (at.joint.damping != 0.0) damping += at.joint.damping * (dual.turn * motion.turn);
    if (!at.loaded) return;
    damping += y * (at.force.damping * x + at.turned.damping * angle) +
               other * (at.across.damping * x + at.moment.damping * angle);
  }
  Lanes sum(const Problem& problem) const {
    return (2.0 * problem.powers.one) * mass + problem.flow * flow + damping;
  }
};

/// Numbers of a segment that the sweep from the clamp needs: stiffness of all beyond, and 1 / p.
struct Segment {
  DynamicStiffness beyond;
  Lanes share;
};

/// Angles by which the loads of the right and the left vector turn a segment.
struct Turned {
  Lanes right, left;
};

void pairs(const ChainModel& model, const Points& points, const PairsAsked& out) {
  const Count n = model.size;
  Count start = 0;  // first segment that moves
  while (model.dynamic_stiffnesses[start].held) ++start;
  struct Scratch {
    Segment* segments;
    Turned* turned_by;
  };
  const auto [segments, turned_by] = laid_out([&](Layout& layout) {
    return Scratch{layout.take<Segment>(n), layout.take<Turned>(out.loaded ? n : 0)};
  });
  for (Count first = 0; first < points.count; first += width) {
    const Problem problem(model, lanes_of(points, first), points.u);
    DynamicStiffness at = end_stiffness(model, problem);
    LoadBeyond load, dual;
    double weight = 0.5;  // factor of the load on a joint
    Coefficients<Lanes> own;
    for (Count j = n - 1; j >= 0; --j) {
      const StiffnessSegment& segment = model.dynamic_stiffnesses[j];
      const double l = segment.length;
      if (!segment.repeats) own = coefficients(segment, problem.powers);
      if (segment.held) {  // the guide balances forces; moments act as forces on the joint before
        segments[j].beyond = at;
        at = before_held(l, at, own, problem.thrust);
        load = {(-1.0 / l) * load.moment, {}, {}};
        dual = {(-1.0 / l) * dual.moment, {}, {}};
        continue;
      }
      const Step step(l, at, own);
      const Lanes share = inverse(step.p), e = own.elastic * share;
      const Lanes pushed = step.h + problem.thrust;
      if (out.loaded) {
        const Lanes moment{weight * (size_of(own.elastic) + size_of(own.moment)), {}};
        load.turned = (moment - load.moment - l * load.force) * share;
        dual.turned = (moment - dual.moment - l * dual.force) * share;
        load.force += pushed * load.turned;
        dual.force += step.w * dual.turned;
        load.moment = Lanes{} - own.elastic * load.turned;
        dual.moment = Lanes{} - own.elastic * dual.turned;
        weight += weight < 1.0 ? 0.382 : -0.618;  // irregular, so that it excites every mode
        turned_by[j] = {load.turned, dual.turned};
      }
      segments[j] = {at, share};
      at = {at.a + own.force - pushed * (step.w * share),
            step.h * e - problem.thrust * (step.r * share), step.w * e, step.r * e};
    }
    // First angle of vectors without loads: it is set, because 1 / p may be infinite.
    const Lanes free{all<Pack>(out.loaded ? 0.0 : 1.0), {}};
    Motion x, y;
    const Powers<Pack> sizes = problem.sizes();
    Rates rates, own_rates;
    Lanes value, pressed, joint_moment, force_before;
    Pack rest{}, entries{}, sums{};
    for (Count j = 0; j < start; ++j) {
      if (out.right != nullptr) put(out.right + 2 * j * points.count, points, first, x.turn);
      if (out.left != nullptr) put(out.left + 2 * j * points.count, points, first, y.turn);
    }
    Coefficients<Pack> terms;
    for (Count j = start; j < n; ++j) {
      const StiffnessSegment& segment = model.dynamic_stiffnesses[j];
      const double l = segment.length;
      if (j == start || !model.dynamic_stiffnesses[j - 1].repeats) {
        own = coefficients(segment, problem.powers);
        terms = coefficients(segment, sizes);
      }
      const auto& [at, share] = segments[j];
      const Turned loaded = out.loaded ? turned_by[j] : Turned{};
      const Lanes angle_before = x.angle, dual_before = y.angle;
      const Step step(l, at, own);
      const Lanes rest_of_p = own.elastic + own.moment + at.d;
      if (segment.held) {
        x.move_to_guide(l);
        y.move_to_guide(l);
      } else if (j == start) {
        x.turn = x.angle = out.loaded ? loaded.right : free;
        y.turn = y.angle = out.loaded ? loaded.left : free;
        x.end = l * x.turn;
        y.end = l * y.turn;
      } else {
        x.move(l, share, own.elastic, step.r, step.w, rest_of_p + l * (at.b - own.across),
               loaded.right);
        y.move(l, share, own.elastic, step.r, step.h + problem.thrust,
               rest_of_p + l * (at.c - own.turned) + -l * problem.thrust, loaded.left);
      }
      rates.add(segment, y, x);
      if (out.by_right != nullptr)
        own_rates.add(segment, {conjugate(x.turn), conjugate(x.angle), conjugate(x.joint), {}}, x);
      pressed += y.joint * x.turn;
      // Sums of Y^T (T X) and |Y|^T |T X|; now that this segment's joint is known, the row of the
      // moments of the segment before is complete.
      const Lanes elastic = own.elastic * x.turn;
      const Lanes dual_moment = own.elastic * y.turn + problem.thrust * y.joint;
      Lanes force = at.a * x.end + at.b * x.angle, dual_force = at.a * y.end + at.c * y.angle;
      if (segment.held) {  // the force of the guide included
        const Lanes turned = own.moment + at.d;
        force = (-1.0 / l) * (elastic + turned * x.angle + own.across * x.joint);
        dual_force = (-1.0 / l) * (dual_moment + turned * y.angle + own.turned * y.joint);
      }
      const Pack dual_angles = size_of(y.angle), dual_joints = size_of(y.joint);
      const auto add = [&](const Lanes& dual_row, const Lanes& row) {
        value += dual_row * row;
        rest += size_of(dual_row) * size_of(row);
      };
      add(dual_before, joint_moment - elastic);
      add(dual_moment, x.angle - angle_before - x.turn);
      add(Lanes{} - dual_force, x.end - x.joint - l * x.angle);
      if (j > start) {
        add(y.joint, own.force * x.joint + own.turned * x.angle + problem.thrust * x.turn + force -
                         force_before);
      }
      joint_moment = elastic + own.moment * x.angle + own.across * x.joint + l * force;
      // Absolute values of the terms of Y^T T X, and of the terms whose sums are theta, w and the
      // corresponding entries of Y.
      const Pack turns = size_of(x.turn), angles = size_of(x.angle), joints = size_of(x.joint);
      entries +=
          terms.elastic * size_of(y.turn) * turns +
          dual_angles * (terms.moment * angles + terms.across * joints) +
          dual_joints * (terms.force * joints + terms.turned * angles + problem.thrust * turns);
      sums += size_of(dual_moment) * (turns + angles + size_of(angle_before)) +
              size_of(dual_force) * (size_of(x.end) + joints + l * angles) +
              size_of(elastic) * (dual_angles + size_of(dual_before)) +
              size_of(force) * (dual_joints + size_of(y.end));
      force_before = force;
      if (out.right != nullptr) put(out.right + 2 * j * points.count, points, first, x.turn);
      if (out.left != nullptr) put(out.left + 2 * j * points.count, points, first, y.turn);
    }
    if (model.guided) {
      pressed += Lanes{} - y.end * x.angle;
      entries += std::fabs(problem.thrust) * (size_of(y.end) * size_of(x.angle));
    }
    if (model.entry != 0.0) {
      const double share = -model.entry / model.coriolis;
      const Lanes end = share * x.end;
      rates.flow += y.end * end;
      own_rates.flow += conjugate(x.end) * end;
      entries += std::fabs(problem.entry) * sizes.one * (size_of(y.end) * size_of(x.end));
    }
    value += y.angle * joint_moment;
    rest += size_of(y.angle) * size_of(joint_moment);
    put(out.value, points, first, value);
    put(out.by_lambda, points, first, rates.sum(problem));
    put(out.by_u, points, first,
        (model.coriolis * problem.powers.one) * rates.flow +
            (2.0 * model.thrust[0] * points.u) * pressed);
    if (out.by_right != nullptr) put(out.by_right, points, first, own_rates.sum(problem));
    put(out.rest, points, first, rest);
    put(out.entries, points, first, entries);
    put(out.sums, points, first, sums);
  }
}

}  // namespace

namespace pipedyn {

const StiffnessKernel PIPEDYN_NAMED(stiffness) = {.log_derivative = ::log_derivative,
                                                  .pairs = ::pairs};

}  // namespace pipedyn
