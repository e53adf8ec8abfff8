// What the published method (force_shading) reduces over, for the solids of the cases: one full ray
// cast of the samples at every publication, 512 x 424 pixels, f 365, from 1 m off the origin of S.
#pragma once

#include <functional>

#include "tools/measure/support/haptic_rig.hpp"

namespace stability {

// For rig::Scene::cast. The camera leans 45 degrees from +z to `lean` of S, or 20, or 0, whichever
// first sees the middle: from within the solid it would see nothing. It casts again only when a
// sample has changed.
[[nodiscard]] std::function<bool(const rig::Scene::Node&, tasks::SurfacePoints&)> ray_cast_of(
    const rig::Pose& X_WS, const std::function<double(const rig::Vec3&)>& solid,
    const rig::Vec3& lean);

}  // namespace stability
