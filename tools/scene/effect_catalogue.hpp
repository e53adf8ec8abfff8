// The catalogue of effects that a scene can ask for: name, key, and who pays. An effect that no key
// of a scene asks for is neither built nor executed.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "tools/scene/scene.hpp"

namespace teletact {

struct EffectRow {
  const char* name;     // as RobotBox::effects() and OperatorBox::effects() have it
  const char* key;      // dotted, of the scene file; of a list, the list
  const char* paid_by;  // task, or the twin whose CPU is taken off the task's
  const char* what;     // one line, for a person
  const char* ask;      // TOML that, added to a scene without effects, asks for this one
};
[[nodiscard]] std::span<const EffectRow> effect_catalogue();
// Of that name; null: no such row.
[[nodiscard]] const EffectRow* effect_named(const std::string& name);

struct ExplainedEffect {
  const EffectRow* row = nullptr;
  std::string value;  // of its key, as TOML; "in the file" of a list
};
struct Explained {
  std::vector<ExplainedEffect> asked;       // built in boxes of this scene
  std::vector<const EffectRow*> not_asked;  // and all others
};
// Builds both boxes of the scene, with twins and the coarsest voxel that the scene allows, and asks
// them what they have built. Throws std::runtime_error with one line; std::logic_error if a box
// built an effect that is not in the catalogue.
[[nodiscard]] Explained explain_effects(rt::NonRealtime&, Scene& scene);

}  // namespace teletact
