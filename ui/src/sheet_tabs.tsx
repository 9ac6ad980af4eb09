// In the corner of the timeline: keys by rows, or curves.

import { sheetTab } from "./layout";
import { Tabs } from "./tabs";

export function SheetTabs() {
  return (
    <div class="sheet-tabs">
      <Tabs
        label="Keys as rows or as curves"
        tabs={[
          { id: "timeline", title: "Timeline" },
          { id: "graph", title: "Graph" },
        ]}
        now={sheetTab.value}
        onChoose={(id) => (sheetTab.value = id)}
      />
    </div>
  );
}
