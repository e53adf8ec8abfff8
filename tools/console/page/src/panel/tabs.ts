// The panes at the right, one shown. Arrow keys go from tab to tab.
import { button, by } from './dom';

export function tabs(panes: Record<string, HTMLElement>): (name: string) => void {
  const names = Object.keys(panes);
  const buttons = new Map<string, HTMLButtonElement>();
  const show = (name: string) => {
    for (const [other, pane] of Object.entries(panes)) {
      pane.hidden = other !== name;
      buttons.get(other)!.setAttribute('aria-selected', String(other === name));
      buttons.get(other)!.tabIndex = other === name ? 0 : -1;
    }
  };
  for (const [name, pane] of Object.entries(panes)) {
    pane.setAttribute('role', 'tabpanel');
    pane.setAttribute('aria-label', name);
    pane.id = `pane-${name.toLowerCase()}`;
    const tab = button(name, () => show(name), { role: 'tab', 'aria-controls': pane.id });
    tab.addEventListener('keydown', event => {
      const step = event.key === 'ArrowRight' ? 1 : event.key === 'ArrowLeft' ? -1 : 0;
      if (step === 0) return;
      const next = names[(names.indexOf(name) + step + names.length) % names.length]!;
      show(next);
      buttons.get(next)!.focus();
    });
    buttons.set(name, tab);
  }
  by('tabs').append(...buttons.values());
  by('panes').append(...Object.values(panes));
  show(names[0]!);
  return show;
}
