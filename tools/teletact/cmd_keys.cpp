// teletact keys: the lab's CA and the certificates of its boxes. docs/security.md.
#include <CLI/CLI.hpp>
#include <string>

#include "tools/cli/options.hpp"
#include "tools/keys/key_actions.hpp"
#include "tools/keys/key_lab.hpp"
#include "tools/keys/web_lab.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_keys(int argc, char** argv) {
  KeysOptions o;
  CLI::App app("The lab's CA and the certificates of its boxes", "teletact keys");
  app.require_subcommand(1);
  const auto action = [&](const char* name, const char* help) {
    CLI::App* a = app.add_subcommand(name, help);
    if (std::string(name) != "show")
      a->add_option("--folder", o.folder, "of the lab")->capture_default_str();
    return a;
  };
  CLI::App* const to_init = action("init", "make a lab: a CA, and an empty list of revoked ones");
  to_init->add_option("name", o.name, "of the lab")->required();
  CLI::App* const to_issue = action("issue", "a key and a certificate for a box");
  to_issue->add_option("role", o.role, "robot or operator")
      ->required()
      ->check(CLI::IsMember({"robot", "operator"}));
  to_issue->add_option("name", o.name, "of the box")->required();
  CLI::App* const to_renew = action("renew", "a new certificate for a box that has one");
  to_renew->add_option("name", o.name, "of the box")->required();
  to_renew->add_flag("--new-key", o.new_key,
                     "with a new key: update every peer that pins the old key");
  for (CLI::App* a : {to_init, to_issue, to_renew})
    a->add_option("--days", o.days, "it is valid (CA 3650, box 365)")
        ->check(CLI::Range(1, KeyLab::kMostDays));
  CLI::App* const to_revoke = action("revoke", "no box lets it in any more");
  to_revoke->add_option("name", o.name, "of the box")->required();
  CLI::App* const to_web = action("web", "a certificate for the console of a box, for browsers");
  to_web->add_option("name", o.name, "of the box")->required();
  to_web->add_option("host", o.hosts, "names and addresses by which browsers reach it")->required();
  CLI::App* const to_browser = action("browser", "a certificate for a browser or tablet");
  to_browser->add_option("name", o.name, "of the browser")->required();
  to_browser->add_flag("--revoke", o.revoke, "no console lets it in any more");
  for (CLI::App* a : {to_web, to_browser})
    a->add_option("--days", o.days, "it is valid (365)")->check(CLI::Range(1, WebLab::kMostDays));
  CLI::App* const to_list = action("list", "what was issued, and what expires when");
  to_list->add_option("--warn-days", o.warn_days, "exit 1 where something ends sooner")
      ->check(CLI::Range(0, KeyLab::kMostDays))
      ->capture_default_str();
  CLI::App* const to_show = action("show", "what a certificate says");
  to_show->add_option("file", o.what, "box.crt")->required();
  if (!parse_options(app, argc, argv)) return 0;
  if (*to_list) return list_keys(o);
  if (*to_web || *to_browser) {
    (*to_web ? issue_web : issue_browser)(o);
    return 0;
  }
  (*to_init     ? init_lab
   : *to_issue  ? issue_box
   : *to_renew  ? renew_box
   : *to_revoke ? revoke_box
                : show_certificate)(o);
  return 0;
}

}  // namespace teletact
