// What `teletact keys` does: each reads or changes the lab's folder and says on stdout what it did.
// Throws std::runtime_error with one line.
#pragma once

#include <string>
#include <vector>

namespace teletact {

struct KeysOptions {
  std::string folder = "keys", name, role, what;
  std::vector<std::string> hosts;
  int days = 0, warn_days = 30;
  bool new_key = false, revoke = false;
};

void init_lab(const KeysOptions&);
void issue_box(const KeysOptions&);
void renew_box(const KeysOptions&);
void revoke_box(const KeysOptions&);
void issue_web(const KeysOptions&);
void issue_browser(const KeysOptions&);  // or revokes it
// 1: something that is in use ends soon, or has ended.
int list_keys(const KeysOptions&);
void show_certificate(const KeysOptions&);

}  // namespace teletact
