// The left panel: poses, policies and takes, one of them in front.

import { type LeftTab, leftTab } from "./layout";
import { Policies } from "./policies";
import { NoModel } from "./policy_settings";
import { Poses } from "./poses";
import * as store from "./store";
import { Tabs } from "./tabs";
import { TakeList } from "./takes";

export function Left() {
  const tab = leftTab.value;
  const tabs: { id: LeftTab; title: string; count?: number | undefined }[] = [
    { id: "poses", title: "Poses" },
    { id: "policies", title: "Policies" },
    { id: "takes", title: "Takes", count: store.takes.value.length },
  ];
  return (
    <aside class="left" aria-label="Poses, policies and takes">
      <Tabs label="Left panel" tabs={tabs} now={tab} onChoose={(id) => (leftTab.value = id)} />
      <NoModel />
      {tab === "poses" ? <Poses /> : tab === "policies" ? <Policies /> : <TakeList />}
    </aside>
  );
}
