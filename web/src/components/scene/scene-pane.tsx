/** The live map, and below it the robot's state in words and numbers. */
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { degrees, fixed, metres, percent, wholeSeconds, speed } from "../../i18n/format";
import { useRobotState } from "../../hooks/use-robot-state";
import { robotName, useStore } from "../../state/store";
import { PaneBoundary } from "../common/pane-boundary";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { SceneView } from "./scene-view";
import { visibleLine } from "../../wire/visible-text";

/** `lazy`: the map costs power and data, so a phone loads it when its pane is first opened, and keeps it then. */
export function ScenePane({ hidden, lazy }: { hidden: boolean; lazy: boolean }) {
  const { t } = useTranslation();
  const [wanted, setWanted] = useState(!lazy);
  if (!hidden && !wanted) setWanted(true);
  return (
    <section className="pane scene" aria-label={t("scene.title")} data-hidden={hidden} inert={hidden}>
      <PaneBoundary name={t("scene.title")}>
        {wanted ? <SceneView shown={!hidden} alone={lazy} /> : <div className="scene-view" />}
      </PaneBoundary>
      <PaneBoundary name={t("status.label")}>
        <StatusList />
      </PaneBoundary>
    </section>
  );
}

function StatusList() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const telemetry = useStore((state) => state.telemetry);
  if (telemetry?.online !== true) {
    return <p className="status-none muted small">{t("scene.noData", { robot })}</p>;
  }
  const { pose, motion, battery, charging, linear } = telemetry;
  return (
    <dl className="status-list">
      <Row name={t("scene.doing")} wide twice>
        <ActivityText />
      </Row>
      <Row name={t("scene.goal")} wide>
        {motion === null || motion.kind === "rotate" ? (
          <span className="muted">{t("scene.noGoal")}</span>
        ) : (
          <>
            {(motion.place && visibleLine(motion.place)) ??
              (motion.goal && t("scene.point", { x: fixed(motion.goal.x, 1), y: fixed(motion.goal.y, 1) }))}
            {motion.distance !== null && motion.seconds !== null && (
              <span className="muted">
                {" "}
                ·{" "}
                {t("scene.goalLeft", {
                  distance: metres(motion.distance),
                  seconds: wholeSeconds(motion.seconds),
                })}
              </span>
            )}
          </>
        )}
      </Row>
      <Row name={t("scene.position")}>
        {pose && t("scene.pose", { x: fixed(pose.x, 2), y: fixed(pose.y, 2), deg: degrees(pose.yaw) })}
      </Row>
      <Row name={t("scene.speed")} twice>
        {linear === null ? t("status.unknown") : speed(linear)}
      </Row>
      <Row name={t("scene.battery")} twice>
        {battery === null ? t("status.unknown") : percent(battery)}
        {charging && <span className="muted"> · {t("scene.charging")}</span>}
      </Row>
    </dl>
  );
}

/** `twice`: the header or the plots show the same value. */
function Row(props: { name: string; wide?: boolean; twice?: boolean; children: React.ReactNode }) {
  const { name, wide, twice, children } = props;
  return (
    <div className="status-row" data-wide={wide} data-twice={twice}>
      <dt>{name}</dt>
      <dd>{children}</dd>
    </div>
  );
}

function ActivityText() {
  const { t } = useTranslation();
  const state = useRobotState();
  const speaking = useStore((all) => all.telemetry?.speaking ?? null);
  if (speaking !== null)
    return <SentenceWithQuote sentence={t("scene.saying", { text: speaking })} quote={speaking} />;
  if (state.kind === "ready") return t("scene.standing");
  if (state.kind === "driving" && state.place !== null) return t("state.drivingTo", { place: state.place });
  return t(`state.${state.kind}`);
}
